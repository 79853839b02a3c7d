//! A map's files, read back by libraries that share nothing with lexsplat.

use lexsplat_tests::{Robot, Server, root, tiny_config};
use std::process::Command;

#[tokio::test(flavor = "multi_thread")]
async fn other_peoples_libraries_read_the_files_and_find_them_equal() {
    let server = Server::start(tiny_config()).await;
    server.stream(&Robot::new(5, 16), "files").await;
    server.settled("files").await;
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    for (file, options) in [
        ("splats.ply", ""),
        ("splats.spz", ""),
        ("splats.glb", ""),
        ("language.npz", ""),
        ("points.ply", ""),
        ("mesh.ply", "?voxel=0.04&text=chair"),
    ] {
        let url = server.url(&format!("/v1/maps/files/export/{file}{options}"));
        let reply = reqwest::get(url).await.expect("it answers");
        assert!(reply.status().is_success(), "{file}: {}", reply.text().await.unwrap_or_default());
        let bytes = reply.bytes().await.expect("with bytes");
        std::fs::write(folder.path().join(file), bytes).expect("it can be written");
    }
    let readers = std::env::join_paths([root().join(".deps/readers"), root().join(".deps/gsply")]);
    let reader = Command::new("python3")
        .env("PYTHONPATH", readers.expect("paths without colons"))
        .arg(root().join("tests/outside/files.py"))
        .arg(folder.path())
        .output()
        .expect("python3 runs");
    let said = String::from_utf8_lossy(&reader.stdout);
    let complained = String::from_utf8_lossy(&reader.stderr);
    assert!(
        reader.status.success(),
        "{said}{complained} (deploy/setup.sh --tests installs what it needs)"
    );
    println!("{said}");
    let asker = Command::new("python3")
        .env("PYTHONPATH", root().join(".deps/readers"))
        .arg(root().join("tests/outside/ask.py"))
        .args([&server.http, "files", "3", "chair", "table", "floor", "wall"])
        .output()
        .expect("python3 runs");
    let said = String::from_utf8_lossy(&asker.stdout);
    let complained = String::from_utf8_lossy(&asker.stderr);
    assert!(asker.status.success(), "{said}{complained}");
    assert!(said.contains("floor: ") && said.contains("nearest chair"), "{said}");
    println!("{said}");
    server.stop().await;
}
