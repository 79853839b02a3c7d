//! The 3D view of the dashboard in a real browser.

use crate::dashboard::{chromium, used};
use lexsplat_tests::{Robot, Server, tiny_config};

#[tokio::test(flavor = "multi_thread")]
async fn a_browser_shows_splats_colors_them_measures_and_sees_them_grow() {
    let Some(chromium) = chromium() else { return };
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
    let told = used("tests/outside/space.py", chromium, &server, &robot, folder.path()).await;
    assert!(told.contains("10 steps"), "{told}");
    server.stop().await;
}
