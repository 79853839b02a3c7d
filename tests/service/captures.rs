//! Files of Record3D and ScanNet, written here after their published layouts, are mapped.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use lexsplat_client::Access;
use lexsplat_client::dataset::{Dataset, R3d, ScanNet};
use lexsplat_client::stream::{Encoder, Poses, StreamOptions, stream};
use lexsplat_synthetic::Camera;
use lexsplat_tests::{Robot, Server, tiny_config};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const FRAMES: usize = 12;
const SIZE: (u32, u32) = (160, 120);
/// How much smaller depth is than color.
const SMALLER: u32 = 2;
const CLOSE_METRES: f64 = 1e-4;

/// Every second pixel of depth, across and down.
fn small(depth: &[f32]) -> Vec<f32> {
    let (width, height) = (SIZE.0 / SMALLER, SIZE.1 / SMALLER);
    let at = |x: u32, y: u32| depth[(SMALLER * y * SIZE.0 + SMALLER * x) as usize];
    (0..height).flat_map(|y| (0..width).map(move |x| at(x, y))).collect()
}

fn record3d(robot: &Robot, path: &Path) {
    let Camera { width, height, fx, fy, cx, cy } = robot.camera;
    let mut zip = ZipWriter::new(File::create(path).expect("it can be made"));
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let flip = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let poses = robot.poses.iter().map(|pose| {
        let (turn, place) = (pose.rotation * flip, pose.translation);
        [turn.i, turn.j, turn.k, turn.w, place.x, place.y, place.z]
    });
    let metadata = serde_json::json!({
        "w": width, "h": height, "dw": width / SMALLER, "dh": height / SMALLER, "fps": 60,
        "K": [fx, 0, 0, 0, fy, 0, cx, cy, 1], "poses": poses.collect::<Vec<_>>(),
        "perFrameIntrinsicCoeffs": vec![[fx, fy, cx, cy]; FRAMES],
        "frameTimestamps": (0..FRAMES).map(|at| at as f64 / 60.0).collect::<Vec<_>>(),
    });
    let mut put = |name: String, bytes: &[u8]| {
        zip.start_file(name, options).expect("it can be written");
        zip.write_all(bytes).expect("it can be written");
    };
    put("metadata".into(), metadata.to_string().as_bytes());
    for at in 0..FRAMES {
        put(format!("rgbd/{at}.jpg"), &robot.frame(at).color);
        let depth = small(&robot.views[at].depth);
        let bytes: Vec<u8> = depth.iter().flat_map(|metres| metres.to_le_bytes()).collect();
        let mut packed = Vec::new();
        lzfse_rust::encode_bytes(&bytes, &mut packed).expect("it compresses");
        put(format!("rgbd/{at}.depth"), &packed);
        packed.clear();
        lzfse_rust::encode_bytes(&vec![2; depth.len()], &mut packed).expect("it compresses");
        put(format!("rgbd/{at}.conf"), &packed);
    }
    zip.finish().expect("it can be written");
}

fn scannet(robot: &Robot, path: &Path) {
    let Camera { width, height, fx, fy, cx, cy } = robot.camera;
    let mut file = Vec::new();
    let floats = |numbers: &[f64]| -> Vec<u8> {
        numbers.iter().flat_map(|number| (*number as f32).to_le_bytes()).collect()
    };
    let matrix = |pose: &Isometry3<f64>| floats(pose.to_homogeneous().transpose().as_slice());
    let lens = |fx, fy, cx, cy| {
        floats(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    };
    let name = b"StructureSensor";
    file.extend(4_u32.to_le_bytes());
    file.extend((name.len() as u64).to_le_bytes());
    file.extend(name);
    file.extend(lens(fx, fy, cx, cy));
    file.extend(matrix(&Isometry3::identity()));
    // The pixels of small depth are those of color at even places.
    let by = f64::from(SMALLER);
    file.extend(lens(fx / by, fy / by, cx / by, cy / by));
    file.extend(matrix(&Isometry3::identity()));
    file.extend([2_i32.to_le_bytes(), 1_i32.to_le_bytes()].concat());
    for side in [width, height, width / SMALLER, height / SMALLER] {
        file.extend(side.to_le_bytes());
    }
    file.extend(1000_f32.to_le_bytes());
    file.extend((FRAMES as u64).to_le_bytes());
    for at in 0..FRAMES {
        file.extend(matrix(&robot.poses[at]));
        let micros = 1_000_000 + at as u64 * 33_333;
        file.extend([micros.to_le_bytes(), micros.to_le_bytes()].concat());
        let color = robot.frame(at).color;
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
        for metres in small(&robot.views[at].depth) {
            let units = (metres * 1000.0).round() as u16;
            encoder.write_all(&units.to_le_bytes()).expect("it compresses");
        }
        let depth = encoder.finish().expect("it compresses");
        file.extend((color.len() as u64).to_le_bytes());
        file.extend((depth.len() as u64).to_le_bytes());
        file.extend(&color[..]);
        file.extend(depth);
    }
    file.extend(0_u64.to_le_bytes());
    std::fs::write(path, file).expect("it can be written");
}

#[tokio::test(flavor = "multi_thread")]
async fn captures_of_phones_and_scanners_are_mapped() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let robot = Robot::with(7, FRAMES, Camera::new(SIZE.0, SIZE.1));
    let (phone, scan) = (folder.path().join("phone.r3d"), folder.path().join("scan.sens"));
    record3d(&robot, &phone);
    scannet(&robot, &scan);
    let server = Server::start(tiny_config()).await;
    let opened: [(&str, Box<dyn Dataset>); 2] = [
        ("phone", Box::new(R3d::open(&phone).expect("it is read"))),
        ("scan", Box::new(ScanNet::open(&scan).expect("it is read"))),
    ];
    for (name, dataset) in opened {
        assert_eq!((dataset.name(), dataset.cameras().are_registered()), (name, false));
        let options = StreamOptions {
            grpc: server.grpc.clone(),
            access: Access::default(),
            map: name.into(),
            poses: Poses::Given,
            encoder: Encoder::Bundle,
            hold_out_every: None,
            realtime: false,
        };
        let summary = stream(Arc::from(dataset), &options, |_| {}).await.expect("it is streamed");
        assert_eq!((summary.tracked, summary.left_out), (FRAMES as u64, 0), "{name}: {summary:?}");
        assert!(summary.input_warnings.is_empty(), "{name}: {:?}", summary.input_warnings);
        server.settled(name).await;
        let snapshot = server.engine.map(name).expect("it is there").snapshot().await;
        let worst = |truth: &[Isometry3<f64>]| {
            let pairs = snapshot.trajectory.iter().zip(truth);
            let far = pairs.map(|(found, truth)| {
                (found.world_from_camera.translation.vector - truth.translation.vector).norm()
            });
            far.fold(0.0, f64::max)
        };
        assert!(worst(&robot.poses) < CLOSE_METRES, "{name}: {}", worst(&robot.poses));
        let other = Robot::with(8, FRAMES, robot.camera).poses;
        assert!(worst(&other) > CLOSE_METRES, "negative control");
        let seen = snapshot.gaussians.len();
        println!("{name}: {seen} Gaussians");
        assert!(seen > 1000, "{name}: its depth became a map");
    }
    server.stop().await;
}
