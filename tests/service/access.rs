//! Who may call what: every route and every call, without a token, with a wrong one, with one that lacks
//! the scope or the map, and with the right one.

use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_proto::v1::{self, frame_message::Message};
use lexsplat_server::access::{Scope, issue};
use lexsplat_server::config::Config;
use lexsplat_tests::{Server, first_error, program, tiny_config};
use reqwest::{Method, RequestBuilder, StatusCode, header};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use tonic::transport::Channel;
use tonic::{Code, Request, Status};

/// How long a server may take to read its tokens file again.
const PATIENCE: Duration = Duration::from_secs(60);

/// A server that asks who is calling, and tokens for it.
struct Asking {
    server: Server,
    http: reqwest::Client,
    file: PathBuf,
    _folder: tempfile::TempDir,
}

/// A token for these scopes and maps.
fn token(file: &Path, name: &str, scopes: &[Scope], maps: &str) -> String {
    issue(name, scopes, maps, Some(file)).expect("a token can be made").0
}

impl Asking {
    async fn start(public: &[&str], change: impl Fn(&mut Config)) -> Self {
        let folder = tempfile::tempdir().expect("a folder can be made");
        let file = folder.path().join("tokens");
        token(&file, "first", &Scope::ALL, "*");
        let mut config = tiny_config();
        config.access.tokens = Some(file.clone());
        let public = serde_json::from_value(json!(public)).expect("they are known");
        config.access.public = public;
        change(&mut config);
        let server = Server::start(config).await;
        Self { server, http: reqwest::Client::new(), file, _folder: folder }
    }

    fn request(&self, method: &str, path: &str, token: Option<&str>) -> RequestBuilder {
        let method = Method::from_bytes(method.as_bytes()).expect("a method");
        let mut request = self.http.request(method.clone(), self.server.url(path));
        if let Some(token) = token {
            request = request.bearer_auth(token);
        }
        if method == Method::POST { request.json(&body(path)) } else { request }
    }

    async fn status(&self, method: &str, path: &str, token: Option<&str>) -> StatusCode {
        self.request(method, path, token).send().await.expect("the server answers").status()
    }

    /// Waits until a token is known, or is not known any more.
    async fn until(&self, token: &str, expected: StatusCode) {
        let waiting = async {
            while self.status("GET", "/v1/maps", Some(token)).await != expected {
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        };
        tokio::time::timeout(PATIENCE, waiting).await.expect("the tokens file is read again");
    }

    async fn caller(&self, token: Option<&str>) -> Caller {
        let url = format!("http://{}", self.server.grpc);
        let client = MappingClient::connect(url).await.expect("the server listens");
        Caller { client, token: token.map(str::to_owned) }
    }
}

/// A right body for the route, as far as that is needed to get past the question who is calling.
fn body(path: &str) -> Value {
    match path {
        "/v1/maps" => json!({"name": "kitchen"}),
        path if path.ends_with("/query") => json!({"text": "cup"}),
        _ => json!({}),
    }
}

/// Each route, and the scope that it needs; `None`: everybody may.
const ROUTES: [(&str, &str, Option<Scope>); 27] = [
    ("GET", "/", None),
    ("GET", "/dashboard/app.js", None),
    ("GET", "/docs", None),
    ("GET", "/docs/", None),
    ("DELETE", "/v1/session", None),
    ("GET", "/metrics", Some(Scope::Read)),
    ("GET", "/v1/maps", Some(Scope::Read)),
    ("POST", "/v1/maps", Some(Scope::Write)),
    ("GET", "/v1/maps/kitchen", Some(Scope::Read)),
    ("POST", "/v1/maps/kitchen/query", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/queries/x/heatmap", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/queries/x/uncertainty", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/queries/x/points", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/queries/x/labels", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/frames", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/trajectory", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/render?frame=0", Some(Scope::Read)),
    ("POST", "/v1/maps/kitchen/render", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/export/splats.ply", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/events", Some(Scope::Read)),
    ("GET", "/v1/maps/kitchen/import", Some(Scope::Read)),
    ("POST", "/v1/maps/kitchen/import", Some(Scope::Write)),
    ("DELETE", "/v1/maps/kitchen/import", Some(Scope::Write)),
    ("GET", "/v1/maps/kitchen/backup", Some(Scope::Admin)),
    ("PUT", "/v1/maps/kitchen/backup", Some(Scope::Admin)),
    ("PATCH", "/v1/maps/kitchen", Some(Scope::Admin)),
    ("DELETE", "/v1/maps/kitchen", Some(Scope::Admin)),
];

/// Routes that the settings open or close: here they are open but for the last.
const OPEN: [&str; 3] = ["/healthz", "/readyz", "/openapi.json"];

fn all_but(scope: Scope) -> Vec<Scope> {
    Scope::ALL.into_iter().filter(|other| *other != scope).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn every_route_asks_for_its_scope_and_map() {
    let asking = Asking::start(&["healthz", "readyz", "openapi"], |_| {}).await;
    let of = |scope: Scope| token(&asking.file, &format!("has-{scope}"), &[scope], "*");
    let [read, write, admin] = Scope::ALL.map(of);
    let elsewhere = token(&asking.file, "elsewhere", &Scope::ALL, "hall*");
    let lacks = |scope| token(&asking.file, &format!("lacks-{scope}"), &all_but(scope), "*");
    let [no_read, no_write, no_admin] = Scope::ALL.map(lacks);
    asking.until(&no_write, StatusCode::OK).await;
    for (method, path, scope) in ROUTES {
        let what = format!("{method} {path}");
        let Some(scope) = scope else {
            let status = asking.status(method, path, None).await;
            assert!(status.is_success(), "{what}: {status}");
            continue;
        };
        let (right, lacking) = match scope {
            Scope::Read => (&read, &no_read),
            Scope::Write => (&write, &no_write),
            Scope::Admin => (&admin, &no_admin),
        };
        for unknown in [None, Some("lexsplat_0"), Some("")] {
            let reply = asking.request(method, path, unknown).send().await.expect("an answer");
            assert_eq!(reply.status(), StatusCode::UNAUTHORIZED, "{what} as {unknown:?}");
            let challenge = reply.headers()[header::WWW_AUTHENTICATE].to_str().expect("text");
            assert!(challenge.starts_with("Bearer"), "{what}: {challenge}");
        }
        let forbidden = asking.status(method, path, Some(lacking)).await;
        assert_eq!(forbidden, StatusCode::FORBIDDEN, "{what} without {scope}");
        if path != "/v1/maps" || method == "POST" {
            let forbidden = asking.status(method, path, Some(&elsewhere)).await;
            assert_eq!(forbidden, StatusCode::FORBIDDEN, "{what} by who may use other maps");
        }
        let status = asking.status(method, path, Some(right)).await;
        let is_let_in = ![StatusCode::UNAUTHORIZED, StatusCode::FORBIDDEN].contains(&status);
        assert!(is_let_in && !status.is_server_error(), "{what} with {scope}: {status}");
    }
    for path in OPEN {
        for anybody in [None, Some("lexsplat_0")] {
            assert_eq!(asking.status("GET", path, anybody).await, StatusCode::OK, "{path}");
        }
    }
    assert_eq!(asking.status("PUT", "/v1/maps", None).await, StatusCode::METHOD_NOT_ALLOWED);
    asking.server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_table_has_every_route_and_what_is_closed_is_closed() {
    let asking = Asking::start(&["openapi"], |_| {}).await;
    let document = asking.request("GET", "/openapi.json", None).send().await.expect("an answer");
    let document: Value = document.json().await.expect("it is JSON");
    let mut described = BTreeSet::new();
    for (path, methods) in document["paths"].as_object().expect("there are paths") {
        for method in methods.as_object().expect("there are methods").keys() {
            described.insert(format!("{} {path}", method.to_uppercase()));
        }
    }
    let replaced = |path: &str| {
        let path = path.split('?').next().unwrap_or_default();
        let path = path.replace("/kitchen", "/{name}").replace("/x/", "/{query_id}/");
        path.replace("splats.ply", "{file}")
    };
    let mut tried: BTreeSet<String> =
        ROUTES.iter().map(|(method, path, _)| format!("{method} {}", replaced(path))).collect();
    tried.extend(OPEN.map(|path| format!("GET {path}")));
    // Logging in has a test of its own.
    tried.insert("POST /v1/session".into());
    let missing: Vec<&String> = described.difference(&tried).collect();
    assert!(missing.is_empty() && described.len() > 15, "not tried: {missing:?}");

    for path in ["/healthz", "/readyz", "/metrics"] {
        assert_eq!(asking.status("GET", path, None).await, StatusCode::UNAUTHORIZED, "{path}");
    }
    let some_maps = token(&asking.file, "some-maps", &[Scope::Read], "kitchen");
    asking.until(&some_maps, StatusCode::OK).await;
    assert_eq!(asking.status("GET", "/healthz", Some(&some_maps)).await, StatusCode::OK);
    let metrics = asking.status("GET", "/metrics", Some(&some_maps)).await;
    assert_eq!(metrics, StatusCode::FORBIDDEN, "metrics name all maps");
    let url = format!("http://{}", asking.server.grpc);
    let channel = Channel::from_shared(url).expect("an address").connect().await.expect("connects");
    let mut health = tonic_health::pb::health_client::HealthClient::new(channel);
    let request = tonic_health::pb::HealthCheckRequest::default();
    let error = health.check(request).await.expect_err("it is closed");
    assert_eq!(error.code(), Code::Unauthenticated);
    asking.server.stop().await;
}

/// The message that opens a map.
fn opening(map: String) -> v1::FrameMessage {
    let intrinsics = v1::Intrinsics { width: 8, height: 8, fx: 8.0, fy: 8.0, cx: 4.0, cy: 4.0 };
    let open = v1::OpenMap {
        map,
        intrinsics: Some(intrinsics),
        depth_unit_metres: 0.001,
        pose_source: v1::PoseSource::Given.into(),
        ..v1::OpenMap::default()
    };
    v1::FrameMessage { message: Some(Message::Open(open)) }
}

/// Calls with a token.
struct Caller {
    client: MappingClient<Channel>,
    token: Option<String>,
}

/// Each call, and the scope that it needs.
const CALLS: [(&str, Scope); 9] = [
    ("CreateMap", Scope::Write),
    ("GetMap", Scope::Read),
    ("ListMaps", Scope::Read),
    ("Query", Scope::Read),
    ("QueryChunks", Scope::Read),
    ("ExportMap", Scope::Read),
    ("StreamFrames", Scope::Write),
    ("RenameMap", Scope::Admin),
    ("DeleteMap", Scope::Admin),
];

impl Caller {
    fn with_token<T>(&self, message: T) -> Request<T> {
        let mut request = Request::new(message);
        if let Some(token) = &self.token {
            let value = format!("Bearer {token}").parse().expect("a header");
            request.metadata_mut().insert("authorization", value);
        }
        request
    }

    /// Makes a call about a map; the code with which it failed, `Ok` if it did not.
    async fn call(&mut self, call: &str, map: &str) -> Code {
        let name = map.to_owned();
        let done = match call {
            "CreateMap" => {
                let request = self.with_token(v1::CreateMapRequest { name });
                self.client.create_map(request).await.map(drop)
            }
            "GetMap" => {
                let request = self.with_token(v1::GetMapRequest { name });
                self.client.get_map(request).await.map(drop)
            }
            "ListMaps" => {
                let request = self.with_token(v1::ListMapsRequest::default());
                self.client.list_maps(request).await.map(drop)
            }
            "Query" | "QueryChunks" => {
                let query =
                    v1::QueryRequest { map: name, text: "cup".into(), ..Default::default() };
                let request = self.with_token(query);
                match call {
                    "Query" => self.client.query(request).await.map(drop),
                    _ => self.client.query_chunks(request).await.map(drop),
                }
            }
            "ExportMap" => {
                let export =
                    v1::ExportRequest { map: name, format: "ply".into(), ..Default::default() };
                let request = self.with_token(export);
                self.client.export_map(request).await.map(drop)
            }
            "RenameMap" => {
                let new_name = format!("{name}-2");
                let request = self.with_token(v1::RenameMapRequest { name, new_name });
                self.client.rename_map(request).await.map(drop)
            }
            "DeleteMap" => {
                let request = self.with_token(v1::DeleteMapRequest { name });
                self.client.delete_map(request).await.map(drop)
            }
            _ => self.stream(name).await,
        };
        done.err().map_or(Code::Ok, |status| status.code())
    }

    async fn stream(&mut self, map: String) -> Result<(), Status> {
        let request = self.with_token(tokio_stream::iter([opening(map)]));
        let opened = self.client.stream_frames(request).await;
        first_error(opened).await.map_or(Ok(()), Err)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_call_asks_for_its_scope_and_map() {
    let asking = Asking::start(&[], |_| {}).await;
    let of = |scope: Scope| token(&asking.file, &format!("has-{scope}"), &[scope], "kitchen*");
    let tokens = Scope::ALL.map(of);
    let lacks = |scope| token(&asking.file, &format!("lacks-{scope}"), &all_but(scope), "*");
    let lacking = Scope::ALL.map(lacks);
    asking.until(&lacking[2], StatusCode::OK).await;
    for (call, scope) in CALLS {
        let at = Scope::ALL.iter().position(|other| *other == scope).expect("it is one of them");
        for unknown in [None, Some("lexsplat_0")] {
            let code = asking.caller(unknown).await.call(call, "kitchen").await;
            assert_eq!(code, Code::Unauthenticated, "{call} as {unknown:?}");
        }
        let code = asking.caller(Some(&lacking[at])).await.call(call, "kitchen").await;
        assert_eq!(code, Code::PermissionDenied, "{call} without {scope}");
        let mut right = asking.caller(Some(&tokens[at])).await;
        if call != "ListMaps" {
            let code = right.call(call, "hall").await;
            assert_eq!(code, Code::PermissionDenied, "{call} about a map that it may not use");
        }
        let code = right.call(call, "kitchen").await;
        let not_let_in =
            [Code::Unauthenticated, Code::PermissionDenied, Code::Internal, Code::Unknown];
        assert!(!not_let_in.contains(&code), "{call} with {scope}: {code:?}");
    }
    asking.server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn lists_show_the_maps_that_the_caller_may_use() {
    let asking = Asking::start(&[], |_| {}).await;
    let all = token(&asking.file, "all", &Scope::ALL, "*");
    let some = token(&asking.file, "some", &[Scope::Read], "kitchen*,attic");
    asking.until(&some, StatusCode::OK).await;
    let mut owner = asking.caller(Some(&all)).await;
    for map in ["kitchen", "kitchen-2", "hall", "my-kitchen", "attic"] {
        assert_eq!(owner.call("CreateMap", map).await, Code::Ok, "{map}");
    }
    let expected = ["attic", "kitchen", "kitchen-2"];
    let maps = asking.request("GET", "/v1/maps", Some(&some)).send().await.expect("an answer");
    let maps: Value = maps.json().await.expect("it is JSON");
    let maps = maps["maps"].as_array().expect("a list");
    let names: BTreeSet<&str> = maps.iter().filter_map(|map| map["name"].as_str()).collect();
    assert_eq!(names, BTreeSet::from(expected));
    let mut reader = asking.caller(Some(&some)).await;
    let request = reader.with_token(v1::ListMapsRequest::default());
    let maps = reader.client.list_maps(request).await.expect("it may list").into_inner().maps;
    let names: BTreeSet<&str> = maps.iter().map(|map| map.name.as_str()).collect();
    assert_eq!(names, BTreeSet::from(expected));
    asking.server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn tokens_come_and_go_while_the_server_runs() {
    let asking = Asking::start(&[], |_| {}).await;
    let stays = token(&asking.file, "stays", &[Scope::Read], "*");
    let goes = token(&asking.file, "goes", &[Scope::Read], "*");
    asking.until(&goes, StatusCode::OK).await;
    let text = std::fs::read_to_string(&asking.file).expect("it is there");
    assert!(!text.contains(&stays) && !text.contains(&goes), "only hashes are kept");
    let without: String = text
        .lines()
        .filter(|line| !line.starts_with("goes"))
        .map(|line| format!("{line}\n"))
        .collect();
    std::fs::write(&asking.file, &without).expect("it can be written");
    asking.until(&goes, StatusCode::UNAUTHORIZED).await;
    assert_eq!(asking.status("GET", "/v1/maps", Some(&stays)).await, StatusCode::OK);
    // A broken file changes nothing. The next change shows that it was looked at.
    std::fs::write(&asking.file, without.clone() + "broken\n").expect("it can be written");
    tokio::time::sleep(Duration::from_secs(3)).await;
    assert_eq!(asking.status("GET", "/v1/maps", Some(&stays)).await, StatusCode::OK);
    std::fs::write(&asking.file, &without).expect("it can be written");
    let later = token(&asking.file, "later", &[Scope::Read], "*");
    asking.until(&later, StatusCode::OK).await;
    asking.server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_browser_logs_in_with_a_cookie_that_scripts_cannot_read() {
    let asking = Asking::start(&[], |_| {}).await;
    let reader = token(&asking.file, "reader", &[Scope::Read, Scope::Write], "*");
    asking.until(&reader, StatusCode::OK).await;
    let created = asking.status("POST", "/v1/maps", Some(&reader)).await;
    assert_eq!(created, StatusCode::CREATED);
    let log_in = |token: &str| {
        let request = asking.http.post(asking.server.url("/v1/session"));
        request.json(&json!({"token": token})).send()
    };
    let wrong = log_in("lexsplat_0").await.expect("an answer");
    assert_eq!(wrong.status(), StatusCode::UNAUTHORIZED);
    assert!(wrong.headers().get(header::SET_COOKIE).is_none());
    let reply = log_in(&reader).await.expect("an answer");
    assert_eq!(reply.status(), StatusCode::NO_CONTENT);
    let cookie = reply.headers()[header::SET_COOKIE].to_str().expect("text").to_owned();
    for expected in ["HttpOnly", "SameSite=Strict", "Path=/"] {
        assert!(cookie.contains(expected), "no {expected} in {cookie}");
    }
    let cookie = cookie.split(';').next().expect("name and value").to_owned();
    for path in ["/v1/maps", "/v1/maps/kitchen/events", "/v1/maps/kitchen/frames"] {
        let get = || asking.http.get(asking.server.url(path));
        let without = get().send().await.expect("an answer").status();
        assert_eq!(without, StatusCode::UNAUTHORIZED, "{path}");
        let with = get().header(header::COOKIE, &cookie).send().await.expect("an answer");
        assert_eq!(with.status(), StatusCode::OK, "{path}");
        assert_eq!(with.headers()[header::CACHE_CONTROL], "no-store", "{path}");
    }
    let out = asking.http.delete(asking.server.url("/v1/session")).send().await.expect("an answer");
    let cookie = out.headers()[header::SET_COOKIE].to_str().expect("text").to_owned();
    assert!(cookie.contains("Max-Age=0"), "{cookie}");
    asking.server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_command_line_sends_its_token_and_never_shows_it() {
    let asking = Asking::start(&[], |_| {}).await;
    let reader = token(&asking.file, "reader", &[Scope::Read], "*");
    asking.until(&reader, StatusCode::OK).await;
    let http = asking.server.http.clone();
    let run = |token: &str, arguments: &[&str]| {
        let mut command = Command::new(program("lexsplat"));
        command.env("LEXSPLAT_TOKEN", token).args(arguments);
        let output = command.output().expect("it runs");
        let said = [output.stdout, output.stderr].concat();
        String::from_utf8_lossy(&said).into_owned()
    };
    let ask = ["query", "cup", "--map", "kitchen", "--http", &http];
    for (token, arguments, expected) in [
        (&*reader, &ask[..], "no map is called \"kitchen\""),
        ("lexsplat_0", &ask, "not known"),
        ("two words", &ask, "the token"),
        (&reader, &["query", "--help"], "LEXSPLAT_TOKEN"),
        (&reader, &["query", "--no-such-option"], "no-such-option"),
    ] {
        let said = run(token, arguments);
        assert!(said.contains(expected), "{arguments:?}: {said}");
        assert!(!said.contains(token), "{arguments:?} shows the token: {said}");
    }
    asking.server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn streams_and_events_end_when_their_token_is_withdrawn() {
    let asking = Asking::start(&[], |_| {}).await;
    let goes = token(&asking.file, "goes", &Scope::ALL, "*");
    asking.until(&goes, StatusCode::OK).await;
    let mut robot = asking.caller(Some(&goes)).await;
    let (frames, outbound) = tokio::sync::mpsc::channel(1);
    frames.send(opening("kitchen".into())).await.expect("there is room");
    let outbound = tokio_stream::wrappers::ReceiverStream::new(outbound);
    let request = robot.with_token(outbound);
    let mut acks = robot.client.stream_frames(request).await.expect("it opens").into_inner();
    acks.message().await.expect("it is open").expect("the opening is acknowledged");
    let events = asking.request("GET", "/v1/maps/kitchen/events", Some(&goes)).send().await;
    let events = events.expect("an answer");
    assert_eq!(events.status(), StatusCode::OK);
    // Another caller's line changes: nothing happens to this one.
    let other = token(&asking.file, "other", &[Scope::Read], "*");
    asking.until(&other, StatusCode::OK).await;
    assert!(!frames.is_closed());
    let text = std::fs::read_to_string(&asking.file).expect("it is there");
    std::fs::write(&asking.file, text.replace("goes read", "goes-away read")).expect("written");
    let ended = tokio::time::timeout(PATIENCE, acks.message()).await.expect("the stream ends");
    assert_eq!(ended.expect_err("with a reason").code(), Code::Unauthenticated);
    let rest = tokio::time::timeout(PATIENCE, events.text()).await.expect("the events end");
    assert!(rest.expect("they end well").starts_with("event: status"));
    drop(frames);
    asking.server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn readiness_names_maps_to_those_only_who_may_use_all() {
    let data = tempfile::tempdir().expect("a folder can be made");
    let folder = data.path().join("secret-room.map");
    std::fs::create_dir(&folder).expect("it can be made");
    std::fs::write(folder.join("0.mcap.damaged-1"), "damaged").expect("it can be written");
    let path = data.path().to_owned();
    let asking =
        Asking::start(&["readyz"], |config| config.server.data_dir = Some(path.clone())).await;
    let some = token(&asking.file, "some", &Scope::ALL, "kitchen");
    let all = token(&asking.file, "all", &[Scope::Read], "*");
    asking.until(&all, StatusCode::OK).await;
    for (caller, sees) in [(None, false), (Some(&some), false), (Some(&all), true)] {
        let caller = caller.map(String::as_str);
        let reply = asking.request("GET", "/readyz", caller).send().await.expect("an answer");
        assert_eq!(reply.status(), StatusCode::OK);
        let text = reply.text().await.expect("text");
        assert_eq!(text.contains("secret-room"), sees, "{text}");
        let ready: Value = serde_json::from_str(&text).expect("it is JSON");
        assert_eq!(ready["warnings"].as_array().map(Vec::len), Some(1), "{text}");
    }
    asking.server.stop().await;
}
