//! The command `lexsplat` as a part of pipes: readers that leave, files on standard output, words with
//! commas.

use lexsplat_tests::{Robot, Server, program, tiny_config};
use serde_json::Value;
use std::fs::File;
use std::process::{Command, Output, Stdio};

fn lexsplat(arguments: &[&str]) -> Command {
    let mut command = Command::new(program("lexsplat"));
    command.args(arguments).env_remove("LEXSPLAT_TOKEN").stdin(Stdio::null());
    command
}

/// Runs a command to its end, which has to be good.
fn done(arguments: &[&str]) -> Output {
    let output = lexsplat(arguments).output().expect("it runs");
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {complained}");
    output
}

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe can be made");
    drop(reader);
    writer.into()
}

#[tokio::test(flavor = "multi_thread")]
async fn commands_are_parts_of_pipes() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let mut config = tiny_config();
    config.server.data_dir = Some(folder.path().join("data"));
    let server = Server::start(config).await;
    server.stream(&Robot::new(5, 2), "room").await;
    server.settled("room").await;
    let path = |name: &str| folder.path().join(name).to_str().expect("text").to_owned();
    let (http, out, file) = (&*server.http, path("query"), path("room.tum"));
    let query = |texts: &'static str| {
        ["query", texts, "--map", "room", "--json", "--http", http, "--out", &out]
    };
    let list = ["maps", "ls", "--http", http];
    let export = ["export", "--map", "room", "--format", "tum", "--http", http];

    // A reader that leaves is no failure, and no panic; one of notes neither.
    let asked = query("chair");
    for line in [&list[..], &asked, &["completions", "bash"], &["man", "-"]] {
        let ended = lexsplat(line).stdout(closed()).output().expect("it runs");
        let complained = String::from_utf8_lossy(&ended.stderr);
        assert!(ended.status.success() && complained.is_empty(), "{line:?}: {complained}");
        let ended = lexsplat(line).stdout(closed()).stderr(closed()).status().expect("it runs");
        assert!(ended.success(), "{line:?}: {ended}");
        // Negative control: output that is lost is a failure.
        let full = File::create("/dev/full").expect("Linux has it");
        let ended = lexsplat(line).stdout(full).output().expect("it runs");
        let complained = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{line:?}");
        assert!(complained.contains("cannot write to standard output"), "{line:?}: {complained}");
    }

    // A file that is called - is standard output, and nothing else is there.
    done(&[&export[..], &[&file]].concat());
    let written = std::fs::read(&file).expect("it was written");
    let said = done(&[&export[..], &["-"]].concat()).stdout;
    assert!(!written.is_empty() && said == written, "{} bytes", said.len());
    let backup = done(&["maps", "backup", "room", "-", "--http", http]).stdout;
    assert_eq!(&backup[257..262], b"ustar");

    // A comma separates texts, as on the dashboard.
    let answer = |texts| -> Value {
        serde_json::from_slice(&done(&query(texts)).stdout).expect("it is JSON")
    };
    assert_eq!(answer("bed, window")["texts"], serde_json::json!(["bed", "window"]));
    assert_eq!(answer("bed window")["text"], "bed window");
    server.stop().await;
}
