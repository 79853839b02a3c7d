//! How the dashboard looks in a real browser, compared with pictures of it.

use crate::dashboard::{chromium, used};
use lexsplat_server::pipeline::mapper::Clock;
use lexsplat_tests::{Robot, Server, tiny_config};

#[tokio::test(flavor = "multi_thread")]
async fn the_page_looks_as_in_its_pictures_and_not_if_it_is_broken() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let mut config = tiny_config();
    // The same map each time, and the same picture.
    config.mapper.clock = Clock::PerFrame;
    config.mapper.refine_sweeps = 0;
    let server = Server::start(config).await;
    let robot = Robot::new(7, 48);
    let told = used("tests/outside/looks.py", chromium, &server, &robot, folder.path()).await;
    assert!(told.contains("all looks are right"), "{told}");
    server.stop().await;
}
