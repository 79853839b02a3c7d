//! Answers over gRPC that are larger than the 4 MiB which clients take if nobody says otherwise.

use lexsplat_proto::v1;
use lexsplat_proto::v1::mapping_client::MappingClient;
use lexsplat_tests::{Robot, Server, tiny_config};
use prost::Message as _;
use tokio_stream::StreamExt as _;
use tonic::Code;

/// The longest message that a client takes by default, bytes.
const DEFAULT_BYTES: usize = 4 << 20;

/// A question about a view of this size, from the robot's first pose.
fn question(robot: &Robot, width: u32, height: u32) -> v1::QueryRequest {
    let scale = f64::from(width) / f64::from(robot.camera.width);
    let intrinsics = v1::Intrinsics {
        width,
        height,
        fx: robot.camera.fx * scale,
        fy: robot.camera.fy * scale,
        cx: f64::from(width - 1) / 2.0,
        cy: f64::from(height - 1) / 2.0,
    };
    let [x, y, z] = robot.poses[0].translation.vector.into();
    let pose = v1::Pose {
        rotation: Some(v1::Quaternion { w: 1.0, ..Default::default() }),
        translation_metres: Some(v1::Vector3 { x, y, z }),
    };
    let camera = v1::CameraView { intrinsics: Some(intrinsics), world_from_camera: Some(pose) };
    let view = v1::View { view: Some(v1::view::View::Camera(camera)) };
    v1::QueryRequest {
        map: "room".into(),
        text: "chair".into(),
        view: Some(view),
        ..Default::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn answers_of_any_size_reach_a_client_that_says_nothing_of_sizes() {
    let server = Server::start(tiny_config()).await;
    let robot = Robot::new(5, 2);
    server.stream(&robot, "room").await;
    server.settled("room").await;
    let url = format!("http://{}", server.grpc);
    let mut client = MappingClient::connect(url).await.expect("the server listens");
    let images = &["uncertainty.values", "heatmap.values"][..];
    for (width, height, left_out) in
        [(640, 480, &[][..]), (1280, 1024, images), (1920, 1080, images)]
    {
        let question = question(&robot, width, height);
        let short = client.query(question.clone()).await.expect("it fits").into_inner();
        assert_eq!(short.left_out, left_out, "{width}x{height}");
        let heatmap = short.heatmap.expect("a view has a heat map");
        assert_eq!(heatmap.values.is_empty(), !left_out.is_empty());
        assert_eq!((heatmap.width, heatmap.height), (width, height));

        let chunks = client.query_chunks(question).await.expect("it is answered").into_inner();
        let chunks: Vec<v1::Chunk> =
            chunks.collect::<Result<_, _>>().await.expect("each chunk fits");
        let bytes: Vec<u8> = chunks.iter().flat_map(|chunk| chunk.data.clone()).collect();
        // Negative control: as one message, what was left out would not have fitted.
        assert_eq!(bytes.len() > DEFAULT_BYTES, !left_out.is_empty(), "{} bytes", bytes.len());
        let whole = v1::QueryResponse::decode(&*bytes).expect("an answer");
        assert!(whole.left_out.is_empty());
        let values = whole.heatmap.expect("a view has a heat map").values;
        assert_eq!(values.len(), (width * height) as usize);
        assert_eq!((whole.boxes, whole.peak), (short.boxes, short.peak));
    }
    let nowhere = v1::QueryRequest { map: "nowhere".into(), ..question(&robot, 64, 48) };
    let error = client.query_chunks(nowhere).await.expect_err("there is no such map");
    assert_eq!(error.code(), Code::NotFound);
    server.stop().await;
}
