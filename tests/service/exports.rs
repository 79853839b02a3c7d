//! A map's files, read back by libraries that share nothing with lexsplat.

use lexsplat_tests::{Robot, Server, python, said, tiny_config};

#[tokio::test(flavor = "multi_thread")]
async fn other_peoples_libraries_read_the_files_and_find_them_equal() {
    let server = Server::start(tiny_config()).await;
    server.stream(&Robot::new(5, 16), "files").await;
    server.settled("files").await;
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let files = [
        ("splats.ply", "splats.ply"),
        ("splats.spz", "splats.spz"),
        ("splats.glb", "splats.glb"),
        ("language.npz", "language.npz"),
        ("points.ply", "points.ply"),
        ("mesh.ply", "mesh.ply?voxel_metres=0.04&text=chair"),
    ];
    server.export("files", folder.path(), &files).await;
    let mut reader = python("tests/outside/files.py", &["readers", "gsply"]);
    println!("{}", said(reader.arg(folder.path())));
    let mut asker = python("tests/outside/ask.py", &["readers"]);
    asker.args([&server.http, "files", "3", "chair", "table", "floor", "wall"]);
    let answers = said(&mut asker);
    assert!(answers.contains("floor: ") && answers.contains("nearest chair"), "{answers}");
    println!("{answers}");
    server.stop().await;
}
