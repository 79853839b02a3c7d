//! What each HTTP route and each gRPC call asks of its caller: the one table.
//!
//! What is not in the table is refused. Calls whose map is named in the body are checked again, with
//! its name, by their handlers.

use super::config::Public;
use super::scope::Scope;

/// What a call asks of its caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Need {
    /// Nothing: the files of pages, and logging in.
    Nothing,
    /// To be known, unless the settings open it to everybody.
    Known(Public),
    /// A scope, and the right to use the map that the call names.
    Scope(Scope),
    /// A scope, and the right to use every map, unless the settings open it to everybody.
    AllMaps(Scope, Public),
}

/// Method and path of each HTTP route. A `*` at the end stands for the rest of a path. `HEAD` is
/// looked up as `GET`.
pub(crate) const HTTP: &[(&str, &str, Need)] = &[
    ("GET", "/", Need::Nothing),
    ("GET", "/dashboard/*", Need::Nothing),
    ("GET", "/docs", Need::Nothing),
    ("GET", "/docs/*", Need::Nothing),
    ("POST", "/v1/session", Need::Nothing),
    ("DELETE", "/v1/session", Need::Nothing),
    ("GET", "/healthz", Need::Known(Public::Healthz)),
    ("GET", "/readyz", Need::Known(Public::Readyz)),
    ("GET", "/openapi.json", Need::Known(Public::Openapi)),
    ("GET", "/metrics", Need::AllMaps(Scope::Read, Public::Metrics)),
    ("GET", "/v1/maps", Need::Scope(Scope::Read)),
    ("POST", "/v1/maps", Need::Scope(Scope::Write)),
    ("GET", "/v1/maps/{name}", Need::Scope(Scope::Read)),
    ("PATCH", "/v1/maps/{name}", Need::Scope(Scope::Admin)),
    ("DELETE", "/v1/maps/{name}", Need::Scope(Scope::Admin)),
    ("POST", "/v1/maps/{name}/query", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/queries/{query_id}/heatmap", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/queries/{query_id}/uncertainty", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/queries/{query_id}/points", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/queries/{query_id}/labels", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/frames", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/trajectory", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/render", Need::Scope(Scope::Read)),
    ("POST", "/v1/maps/{name}/render", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/export/{file}", Need::Scope(Scope::Read)),
    ("GET", "/v1/maps/{name}/backup", Need::Scope(Scope::Admin)),
    ("PUT", "/v1/maps/{name}/backup", Need::Scope(Scope::Admin)),
    ("GET", "/v1/maps/{name}/import", Need::Scope(Scope::Read)),
    ("POST", "/v1/maps/{name}/import", Need::Scope(Scope::Write)),
    ("DELETE", "/v1/maps/{name}/import", Need::Scope(Scope::Write)),
    ("GET", "/v1/maps/{name}/events", Need::Scope(Scope::Read)),
];

/// Path of each gRPC call.
pub(crate) const GRPC: &[(&str, Need)] = &[
    ("/lexsplat.v1.Mapping/StreamFrames", Need::Scope(Scope::Write)),
    ("/lexsplat.v1.Mapping/Query", Need::Scope(Scope::Read)),
    ("/lexsplat.v1.Mapping/QueryChunks", Need::Scope(Scope::Read)),
    ("/lexsplat.v1.Mapping/CreateMap", Need::Scope(Scope::Write)),
    ("/lexsplat.v1.Mapping/GetMap", Need::Scope(Scope::Read)),
    ("/lexsplat.v1.Mapping/ListMaps", Need::Scope(Scope::Read)),
    ("/lexsplat.v1.Mapping/RenameMap", Need::Scope(Scope::Admin)),
    ("/lexsplat.v1.Mapping/DeleteMap", Need::Scope(Scope::Admin)),
    ("/lexsplat.v1.Mapping/ExportMap", Need::Scope(Scope::Read)),
    ("/grpc.health.v1.Health/*", Need::Known(Public::Healthz)),
    ("/grpc.reflection.v1.ServerReflection/*", Need::Known(Public::Reflection)),
    ("/grpc.reflection.v1alpha.ServerReflection/*", Need::Known(Public::Reflection)),
];

/// What an HTTP route needs; `path` as the router writes it, with `{name}`.
pub(crate) fn of_http(method: &str, path: &str) -> Option<Need> {
    let method = if method == "HEAD" { "GET" } else { method };
    let row = HTTP.iter().find(|(known, pattern, _)| *known == method && fits(pattern, path));
    row.map(|(.., need)| *need)
}

/// The methods that a path takes, as the header `Allow` lists them.
pub(crate) fn methods(path: &str) -> String {
    let rows = HTTP.iter().filter(|(_, pattern, _)| fits(pattern, path));
    rows.map(|(method, ..)| *method).collect::<Vec<_>>().join(", ")
}

/// What a gRPC call needs.
pub(crate) fn of_grpc(path: &str) -> Option<Need> {
    GRPC.iter().find(|(pattern, _)| fits(pattern, path)).map(|(_, need)| *need)
}

fn fits(pattern: &str, path: &str) -> bool {
    match pattern.strip_suffix('*') {
        Some(start) => path.starts_with(start),
        None => pattern == path,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_proto::DESCRIPTORS;
    use prost::Message as _;

    #[test]
    fn what_is_not_in_the_table_has_no_rule() {
        assert_eq!(of_http("DELETE", "/v1/maps/{name}"), Some(Need::Scope(Scope::Admin)));
        assert_eq!(of_http("HEAD", "/v1/maps"), of_http("GET", "/v1/maps"));
        assert_eq!(of_http("GET", "/dashboard/app.js"), Some(Need::Nothing));
        for (method, path) in [("PUT", "/v1/maps"), ("GET", "/v1/maps/{name}/x"), ("GET", "/x")] {
            assert_eq!(of_http(method, path), None, "{method} {path}");
        }
        assert_eq!(of_grpc("/lexsplat.v1.Mapping/Query"), Some(Need::Scope(Scope::Read)));
        assert_eq!(of_grpc("/lexsplat.v1.Mapping/QueryX"), None);
        assert_eq!(of_grpc("/lexsplat.v2.Mapping/Query"), None);
    }

    /// `google.protobuf.MethodDescriptorProto`, as far as needed.
    #[derive(Clone, PartialEq, prost::Message)]
    struct Call {
        #[prost(string, tag = "1")]
        name: String,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    struct Service {
        #[prost(string, tag = "1")]
        name: String,
        #[prost(message, repeated, tag = "2")]
        calls: Vec<Call>,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    struct File {
        #[prost(string, tag = "2")]
        package: String,
        #[prost(message, repeated, tag = "6")]
        services: Vec<Service>,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    struct Files {
        #[prost(message, repeated, tag = "1")]
        files: Vec<File>,
    }

    #[test]
    fn every_call_of_the_service_has_a_rule() {
        let files = Files::decode(DESCRIPTORS).unwrap().files;
        let mut calls = Vec::new();
        for file in &files {
            for service in &file.services {
                let path =
                    |call: &Call| format!("/{}.{}/{}", file.package, service.name, call.name);
                calls.extend(service.calls.iter().map(path));
            }
        }
        assert!(calls.contains(&"/lexsplat.v1.Mapping/Query".to_owned()), "{calls:?}");
        for call in calls {
            assert!(of_grpc(&call).is_some(), "{call}");
        }
    }
}
