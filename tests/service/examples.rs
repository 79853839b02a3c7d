//! The example programs of the client library, run against a server.

use lexsplat_client::Access;
use lexsplat_client::dataset::Replica;
use lexsplat_synthetic::{Camera, Plan, write};
use lexsplat_tests::{Server, tiny_config};

#[path = "../../client/examples/robot.rs"]
#[expect(dead_code, reason = "the test replaces its main")]
mod robot;

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_streams_a_folder_and_gets_an_answer() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let plan = Plan { seed: 5, frames: 8, every: 1, camera: Camera::new(160, 120) };
    write(folder.path(), &plan, |_| {}).expect("the room can be written");
    let server = Server::start(tiny_config()).await;
    let dataset = || Replica::open(folder.path()).expect("it was written");
    let nobody = Access::default();
    let tracked =
        robot::send(dataset(), "example", &server.grpc, &nobody).await.expect("it streams");
    assert_eq!(tracked, plan.frames);
    let answer =
        robot::ask("chair", "example", &server.http, &nobody).await.expect("it is answered");
    assert_eq!((answer.map.as_str(), answer.text.as_str()), ("example", "chair"));
    // Negative control: errors reach the caller.
    assert!(robot::ask("chair", "missing", &server.http, &nobody).await.is_err());
    server.stop().await;
}
