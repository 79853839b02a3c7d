//! The dashboard in a real browser.

use lexsplat_tests::{Robot, Server, python, said, tiny_config, zipped_walk};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Chromium as Debian installs it; `None` if there is none, or nothing to drive it with.
pub(crate) fn chromium() -> Option<PathBuf> {
    let playwright = lexsplat_tests::root().join(".deps/browser/playwright");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut found = std::env::split_paths(&path).map(|folder| folder.join("chromium"));
    let chromium = found.find(|file| file.exists()).filter(|_| playwright.exists());
    if chromium.is_none() {
        println!(
            "SKIPPED: there is no Chromium, or .deps/browser is missing (deploy/setup.sh --tests)"
        );
    }
    chromium
}

/// Uses the page as a script says, and sends the second half of the robot's walk to the map "room" once the
/// script asks for it with a file `more` in the folder. Returns what the script said.
pub(crate) async fn used(
    script: &str,
    chromium: PathBuf,
    server: &Server,
    robot: &Robot,
    folder: &Path,
) -> String {
    let mut person = python(script, &["browser"]);
    person.arg(server.url("/")).arg(chromium).arg(folder);
    let person = tokio::task::spawn_blocking(move || said(&mut person));
    let more = folder.join("more");
    // It may give up before it asks.
    while !more.exists() && !person.is_finished() {
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    if more.exists() {
        let (half, whole) = (robot.views.len() / 2, robot.views.len());
        let frames = (half..whole).map(|at| robot.frame(at));
        server.send(robot.stream("room", frames)).await.expect("they are taken");
    }
    let said = person.await.expect("it ends");
    println!("{said}");
    said
}

#[tokio::test(flavor = "multi_thread")]
async fn a_browser_opens_asks_changes_views_and_maps_and_sees_the_map_grow() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let mut config = tiny_config();
    config.server.data_dir = Some(folder.path().join("data"));
    let server = Server::start(config).await;
    let robot = Robot::new(5, 48);
    let half = robot.views.len() / 2;
    let first = robot.stream("room", (0..half).map(|at| robot.frame(at)));
    server.send(first).await.expect("they are taken");
    server.stream(&Robot::new(7, 6), "other").await;
    server.settled("room").await;
    let recording = zipped_walk(7, 12);
    std::fs::write(folder.path().join("walk.zip"), recording).expect("it can be written");
    std::fs::write(folder.path().join("room.png"), b"no recording").expect("it can be written");
    let told = used("tests/outside/page.py", chromium, &server, &robot, folder.path()).await;
    assert!(told.contains("13 steps"), "{told}");
    server.stop().await;
}
