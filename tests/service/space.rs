//! The 3D view of the dashboard in a real browser.

use crate::dashboard::chromium;
use lexsplat_tests::{Robot, Server, python, said, tiny_config};
use std::time::Duration;

#[tokio::test(flavor = "multi_thread")]
async fn a_browser_shows_splats_colors_them_measures_and_sees_them_grow() {
    let Some(chromium) = chromium() else {
        println!(
            "SKIPPED: there is no Chromium, or .deps/browser is missing (deploy/setup.sh --tests)"
        );
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(7, 24);
    let half = robot.views.len() / 2;
    server
        .send(robot.stream("room", (0..half).map(|at| robot.frame(at))))
        .await
        .expect("they are taken");
    server.send(vec![robot.open("empty")]).await.expect("it is made");
    server.settled("room").await;
    let mut person = python("tests/outside/space.py", &["browser"]);
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
    let told = person.await.expect("it ends");
    println!("{told}");
    assert!(told.contains("9 steps"), "{told}");
    server.stop().await;
}
