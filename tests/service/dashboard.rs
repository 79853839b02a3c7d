//! The dashboard in a real browser.

use lexsplat_tests::{Robot, Server, python, said, tiny_config};
use std::path::PathBuf;
use std::time::Duration;

/// Chromium as Debian installs it; `None` if there is none, or nothing to drive it with.
pub(crate) fn chromium() -> Option<PathBuf> {
    let playwright = lexsplat_tests::root().join(".deps/browser/playwright");
    let path = std::env::var_os("PATH")?;
    let found = std::env::split_paths(&path).map(|folder| folder.join("chromium"));
    found.into_iter().find(|file| file.exists()).filter(|_| playwright.exists())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_browser_opens_asks_changes_views_and_maps_and_sees_the_map_grow() {
    let Some(chromium) = chromium() else {
        println!(
            "SKIPPED: there is no Chromium, or .deps/browser is missing (deploy/setup.sh --tests)"
        );
        return;
    };
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
    let mut person = python("tests/outside/page.py", &["browser"]);
    person.arg(server.url("/")).arg(chromium).arg(folder.path());
    let person = tokio::task::spawn_blocking(move || said(&mut person));
    // The page asks for the second half of the walk with a file, or gives up before.
    let more = folder.path().join("more");
    while !more.exists() && !person.is_finished() {
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    if more.exists() {
        let frames = (half..robot.views.len()).map(|at| robot.frame(at));
        server.send(robot.stream("room", frames)).await.expect("they are taken");
    }
    assert!(person.await.expect("it ends").contains("11 steps"));
    server.stop().await;
}
