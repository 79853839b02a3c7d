//! The server as a process: its output when it starts or cannot start, and how it stops.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("server/ lies in the root").into()
}

/// The server on free ports.
fn server() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lexsplat-server"));
    command.current_dir(root()).args(["--grpc", "127.0.0.1:0", "--http", "127.0.0.1:0"]);
    command
}

/// The error message of a server that does not start.
fn error_message(output: &Output) -> String {
    assert!(!output.status.success(), "it started");
    assert!(output.stdout.is_empty(), "it reported to be ready");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn is_ready_and_stops_when_told_to() {
    let mut child = server().stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it runs");
    let mut ready = String::new();
    let stdout = child.stdout.take().expect("it is piped");
    BufReader::new(stdout).read_line(&mut ready).expect("it prints a line");
    let ready: serde_json::Value = serde_json::from_str(&ready).expect("one line of JSON");
    assert_eq!(ready["event"], "ready");
    for address in ["grpc", "http"] {
        let address = ready[address].as_str().expect("an address");
        std::net::TcpStream::connect(address).expect("it listens");
    }
    assert!(ready["adapter"].as_str().is_some_and(|name| !name.is_empty()), "{ready}");
    assert_eq!(ready["bundle"], "tiny");
    let told = Command::new("kill").args(["-TERM", &child.id().to_string()]).status();
    assert!(told.expect("kill runs").success());
    let status = child.wait().expect("it ends");
    assert_eq!(status.code(), Some(0), "{status}");
}

#[test]
fn refuses_to_be_open_to_other_machines_without_tokens() {
    for port in ["--grpc", "--http"] {
        // The later option holds. Nothing listens: the address is refused first.
        let mut command = Command::new(env!("CARGO_BIN_EXE_lexsplat-server"));
        let other = if port == "--grpc" { "--http" } else { "--grpc" };
        command.current_dir(root()).args([port, "0.0.0.0:0", other, "127.0.0.1:0"]);
        let said = error_message(&command.output().expect("it runs"));
        for expected in ["0.0.0.0:0", "lexsplat-server token", "--tokens", "--insecure-no-auth"] {
            assert!(said.contains(expected), "{port}: no {expected:?} in: {said}");
        }
    }
    // Negative control: another mistake is told as what it is.
    let mut command = Command::new(env!("CARGO_BIN_EXE_lexsplat-server"));
    command.current_dir(root()).args(["--grpc", "0.0.0.0:no-port", "--http", "127.0.0.1:0"]);
    let said = error_message(&command.output().expect("it runs"));
    assert!(said.contains("server.grpc") && !said.contains("--insecure-no-auth"), "{said}");
}

#[test]
fn a_token_is_printed_once_and_its_hash_is_kept() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let file = folder.path().join("tokens");
    let make = |name: &str, scope: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lexsplat-server"));
        command.args(["token", "--name", name, "--scope", scope, "--maps", "kitchen*", "--tokens"]);
        command.arg(&file).output().expect("it runs")
    };
    let made = make("robot-7", "read,write");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let token = String::from_utf8(made.stdout).expect("text");
    let token = token.trim();
    assert!(token.starts_with("lexsplat_") && !token.contains(char::is_whitespace), "{token}");
    let kept = fs::read_to_string(&file).expect("it was written");
    assert!(kept.starts_with("robot-7 read,write kitchen* sha256:"), "{kept}");
    assert!(!kept.contains(token));
    for (name, scope, expected) in
        [("robot-7", "read", "another name"), ("robot-8", "rule", "read, write or admin")]
    {
        let refused = make(name, scope);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && said.contains(expected), "{said}");
    }
    assert_eq!(fs::read_to_string(&file).expect("it is there"), kept);
}

#[test]
fn refuses_an_unknown_key() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let file = folder.path().join("wrong.toml");
    fs::write(&file, "[mapper]\nmax_gausians = 5\n").expect("it can be written");
    let said = error_message(&server().arg("--config").arg(&file).output().expect("it runs"));
    for expected in ["wrong.toml", "max_gausians", "max_gaussians"] {
        assert!(said.contains(expected), "no {expected:?} in: {said}");
    }
}

#[test]
fn refuses_a_bundle_that_is_missing_or_corrupt() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let said =
        error_message(&server().arg("--models").arg(folder.path()).output().expect("it runs"));
    assert!(said.contains("manifest.toml"), "{said}");
    for entry in fs::read_dir(root().join("models/tiny")).expect("the bundle ships") {
        let from = entry.expect("it can be read").path();
        let name = from.file_name().expect("a file").to_owned();
        fs::copy(&from, folder.path().join(name)).expect("it can be copied");
    }
    let encoder = folder.path().join("encoder.onnx");
    let mut bytes = fs::read(&encoder).expect("it is there");
    bytes.truncate(bytes.len() / 2);
    fs::write(&encoder, bytes).expect("it can be written");
    let said =
        error_message(&server().arg("--models").arg(folder.path()).output().expect("it runs"));
    assert!(said.contains("encoder.onnx"), "{said}");
}

#[test]
fn names_the_package_to_install_without_a_vulkan_adapter() {
    let nowhere = "/nonexistent/driver.json";
    let output = server()
        .env("VK_DRIVER_FILES", nowhere)
        .env("VK_ICD_FILENAMES", nowhere)
        .output()
        .expect("it runs");
    let said = error_message(&output);
    assert!(said.contains("mesa-vulkan-drivers"), "{said}");
    let other = server().args(["--adapter", "no such adapter"]).output().expect("it runs");
    assert!(error_message(&other).contains("no such adapter"));
}

#[test]
fn prints_the_adapters_as_a_table() {
    let output = server().arg("--adapters").env_remove("LEXSPLAT_TIER").output().expect("it runs");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let table = String::from_utf8(output.stdout).expect("UTF-8");
    let mut lines = table.lines();
    let head = lines.next().expect("a heading");
    let best = lines.next().expect("at least one adapter");
    for (title, values) in [
        ("KIND", &["discrete", "integrated", "virtual", "other", "software"][..]),
        ("BACKEND", &["vulkan"]),
        ("TIER", &["software", "portable", "subgroup"]),
    ] {
        let column = head.find(title).unwrap_or_else(|| panic!("no {title} in: {head}"));
        let cell: String = best.chars().skip(column).take_while(|c| !c.is_whitespace()).collect();
        assert!(values.contains(&cell.as_str()), "{title} is {cell:?} in:\n{table}");
    }
}

#[test]
fn adapters_names_the_command_that_installs_one() {
    let nowhere = "/nonexistent/driver.json";
    let output = server()
        .arg("--adapters")
        .env("VK_DRIVER_FILES", nowhere)
        .env("VK_ICD_FILENAMES", nowhere)
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(1));
    let said = error_message(&output);
    assert!(said.contains("apt-get install mesa-vulkan-drivers"), "{said}");
}

#[test]
fn refuses_a_tier_that_the_adapter_cannot_have() {
    let output = server().env("LEXSPLAT_TIER", "quantum").output().expect("it runs");
    let said = error_message(&output);
    assert!(said.contains("LEXSPLAT_TIER") && said.contains("quantum"), "{said}");
    assert!(said.contains("portable"), "it lists the possible tiers: {said}");
}

#[test]
fn check_says_what_is_damaged_without_networks() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let check = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lexsplat-server"));
        command.env("VK_DRIVER_FILES", "/nonexistent").arg("check").arg(folder.path());
        let output = command.output().expect("it runs");
        (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let (code, said) = check();
    assert_eq!(code, Some(1), "it is probably the wrong directory: {said}");
    assert!(said.contains("no map") && said.contains("--data-dir"), "{said}");
    let map = folder.path().join("kitchen.map");
    fs::create_dir(&map).expect("it can be made");
    assert_eq!(check().0, Some(0));
    fs::write(map.join("checkpoint-0001.lexsplat"), "LXSPCKPT and no more").expect("written");
    fs::write(map.join("0001.mcap"), "no recording at all").expect("written");
    let (code, said) = check();
    assert_eq!(code, Some(1), "{said}");
    for file in ["kitchen: 0 frames", "DAMAGED", "0001.mcap: bytes 0 to 19", "checkpoint-0001"] {
        assert!(said.contains(file), "{file} in {said}");
    }
    assert_eq!(fs::read(map.join("0001.mcap")).expect("it is there"), b"no recording at all");
    let missing = Command::new(env!("CARGO_BIN_EXE_lexsplat-server"))
        .args(["check", "/nonexistent"])
        .output()
        .expect("it runs");
    assert_eq!(missing.status.code(), Some(1));
}
