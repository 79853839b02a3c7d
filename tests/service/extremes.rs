//! Settings at the ends of what a file can say: refused with their key, or the server starts with them.

use lexsplat_server::config::Config;
use lexsplat_tests::{Server, tiny_config};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Numbers that no setting is meant to have, and some that are at an end.
const EXTREMES: [&str; 9] = [
    "9223372036854775807",
    "4294967295",
    "0",
    "-1",
    "-9223372036854775808",
    "1.7976931348623157e308",
    "-1.7976931348623157e308",
    "nan",
    "inf",
];

/// A day, seconds.
const DAY: u64 = 24 * 3600;

/// Keys that have no default, which the printed settings lack.
const OPTIONAL: [&str; 2] = ["query.threshold", "query.bias"];

/// How a setting is written.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Integer,
    Float,
    Integers,
}

impl Kind {
    fn of(value: &Value) -> Option<Self> {
        match value {
            Value::Number(number) if number.is_f64() => Some(Self::Float),
            Value::Number(_) => Some(Self::Integer),
            Value::Array(values) if values.iter().any(Value::is_number) => Some(Self::Integers),
            _ => None,
        }
    }

    fn text(self, value: &str) -> String {
        if self == Self::Integers { format!("[{value}]") } else { value.to_owned() }
    }
}

/// The keys of all numbers, and of all lists of numbers.
fn numbers(prefix: &str, value: &Value, found: &mut BTreeMap<String, Kind>) {
    for (name, value) in value.as_object().expect("a section") {
        let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
        if value.is_object() {
            numbers(&key, value, found);
        } else if let Some(kind) = Kind::of(value) {
            found.insert(key, kind);
        }
    }
}

fn all_numbers() -> BTreeMap<String, Kind> {
    let mut found = BTreeMap::new();
    let all = serde_json::to_value(Config::default()).expect("settings are JSON");
    numbers("", &all, &mut found);
    found.extend(OPTIONAL.map(|key| (key.to_owned(), Kind::Float)));
    found
}

/// The smallest and the largest value that is permitted: of integers between powers of two, of others among
/// these.
fn permitted(key: &str, kind: Kind) -> [String; 2] {
    let powers = (0..63).flat_map(|power| [(1_u64 << power) - 1, 1 << power, (1 << power) + 1]);
    let integers = powers.chain([DAY, 1_000_000, 1024]).collect::<BTreeSet<_>>();
    let texts: Vec<String> = match kind {
        Kind::Float => {
            ["0.0", "1e-9", "0.02", "0.5", "1.0", "1.5", "99.0", "86400.0", "1e30", "3e38"]
                .map(str::to_owned)
                .to_vec()
        }
        _ => integers.iter().map(u64::to_string).collect(),
    };
    let is_permitted = |text: &&String| load(&one(key, kind, text)).is_ok();
    let smallest = texts.iter().find(is_permitted).expect(key);
    let largest = texts.iter().rev().find(is_permitted).expect(key);
    [smallest, largest].map(|text| kind.text(text))
}

fn one(key: &str, kind: Kind, value: &str) -> BTreeMap<String, String> {
    BTreeMap::from([(key.to_owned(), kind.text(value))])
}

/// Settings as a file.
fn file(values: &BTreeMap<String, String>) -> String {
    let mut sections = BTreeMap::<&str, String>::new();
    for (key, value) in values {
        let (section, name) = key.rsplit_once('.').expect("a key has a section");
        *sections.entry(section).or_default() += &format!("{name} = {value}\n");
    }
    sections.iter().map(|(section, lines)| format!("[{section}]\n{lines}")).collect()
}

/// Loads settings as the server does.
fn load(values: &BTreeMap<String, String>) -> Result<Config, String> {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("lexsplat.toml");
    std::fs::write(&path, file(values)).expect("it can be written");
    let config = Config::load(Some(&path)).map_err(|error| error.to_string())?;
    config.check().map_err(|error| error.to_string())?;
    Ok(config)
}

/// Takes the pipeline's settings of `config` that a server on this machine needs from the tests' ones.
async fn starts(mut config: Config) {
    let tiny = tiny_config();
    config.language.models = tiny.language.models;
    config.gpu = tiny.gpu;
    let server = Server::start(config).await;
    let reply = reqwest::get(server.url("/healthz")).await.expect("it answers");
    assert!(reply.status().is_success());
    server.stop().await;
}

#[test]
fn extreme_numbers_are_refused_with_their_key() {
    let keys = all_numbers();
    assert!(keys.len() > 100, "{}", keys.len());
    for (key, kind) in &keys {
        for extreme in EXTREMES {
            if let Err(refused) = load(&one(key, *kind, extreme)) {
                assert!(refused.contains(key.as_str()), "{key} = {extreme}: {refused}");
            }
        }
        for never in ["-1", "nan", "inf"] {
            assert!(load(&one(key, *kind, never)).is_err(), "{key} = {never}");
        }
    }
    for (key, value) in [("http.hosts", "[\"a:1\"]"), ("http.cors_origins", "[\"a\"]")] {
        let refused = load(&one(key, Kind::Float, value)).expect_err(key);
        assert!(refused.starts_with(key), "{refused}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_server_starts_with_what_is_permitted() {
    let keys = all_numbers();
    for end in [0, 1] {
        let values = keys.iter().map(|(key, kind)| {
            let [smallest, largest] = permitted(key, *kind);
            (key.clone(), if end == 0 { smallest } else { largest })
        });
        let values = values.collect();
        let config = load(&values).unwrap_or_else(|refused| panic!("{refused}: {values:?}"));
        starts(config).await;
    }
}
