//! The OpenAPI document before a validator and a generator of clients that share nothing with lexsplat.

use lexsplat_tests::{Robot, Server, python, said, tiny_config};

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_is_generated_from_the_document_makes_asks_and_deletes_maps() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(5, 2);
    server.stream(&robot, "room").await;
    server.settled("room").await;
    let mut checks = python("tests/outside/openapi.py", &["openapi"]);
    checks.args([&*server.http, "room", "0"]).arg(folder.path());
    let said = said(&mut checks);
    assert!(said.contains("paths are described"), "{said}");
    server.stop().await;
}
