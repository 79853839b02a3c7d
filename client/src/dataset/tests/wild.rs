//! Data sets as they are met: text of other programs, cameras that no file describes, damaged pictures.

use super::*;

/// The poses' x of the frames of a folder in TUM layout.
fn places(folder: &Path) -> Vec<f64> {
    let dataset = open("tum", folder).unwrap();
    let pose = |at| dataset.moment(at).unwrap().world_from_camera.unwrap();
    (0..dataset.len()).map(|at| pose(at).translation.x).collect()
}

fn edit(folder: &Path, name: &str, change: impl Fn(&str) -> String) {
    let text = fs::read_to_string(folder.join(name)).unwrap();
    put(folder, name, change(&text));
}

#[test]
fn lists_are_read_as_other_programs_write_them() {
    let lists = ["rgb.txt", "depth.txt", "groundtruth.txt"];
    let exponent = |line: &str| {
        let (stamp, rest) = line.split_once(' ').unwrap();
        format!("{:.18e} {rest}", stamp.parse::<f64>().unwrap())
    };
    let each_line = |text: &str, change: &dyn Fn(&str) -> String| {
        let values = text.lines().filter(|line| !line.starts_with('#'));
        values.map(|line| change(line) + "\n").collect::<String>()
    };
    type Change<'a> = &'a dyn Fn(&str) -> String;
    let changes: [(&str, Change); 8] = [
        ("as they are", &|text| text.to_owned()),
        ("CRLF", &|text| text.replace('\n', "\r\n")),
        ("a byte order mark", &|text| format!("\u{feff}{text}")),
        ("exponents", &|text| each_line(text, &exponent)),
        ("commas", &|text| text.replace(' ', ",")),
        ("tabs", &|text| text.replace(' ', "\t")),
        ("a header", &|text| format!("timestamp value\n{}", each_line(text, &str::to_owned))),
        ("backslashes", &|text| text.replace('/', "\\")),
    ];
    for (name, change) in changes {
        let (_keep, folder) = tum("office");
        lists.iter().for_each(|list| edit(&folder, list, change));
        assert_eq!(places(&folder), [2.0, 2.0, 2.0], "{name}");
        assert!(open("tum", &folder).unwrap().frame(0).is_ok(), "{name}");
    }
    let (_keep, folder) = tum("office");
    let units = |text: &str| {
        [0xfeff]
            .into_iter()
            .chain(text.encode_utf16())
            .flat_map(u16::to_le_bytes)
            .collect::<Vec<u8>>()
    };
    for list in lists {
        let text = fs::read_to_string(folder.join(list)).unwrap();
        put(&folder, list, units(&text));
    }
    assert_eq!(places(&folder), [2.0, 2.0, 2.0], "PowerShell");
    let list = fs::read(folder.join("rgb.txt")).unwrap();
    let (_keep, folder) = tum("office");
    put(&folder, "rgb.txt", &list[2..]);
    assert!(open("tum", &folder).is_err(), "control: UTF-16 without its mark is no list");
}

#[test]
fn no_number_is_no_pose_in_any_words() {
    for word in ["nan", "-nan(ind)", "1.#IND", "-1.#INF", "inf"] {
        let words = [word; 16].join(" ");
        let (_keep, folder) = tum("office");
        edit(&folder, "groundtruth.txt", |text| {
            text.replace("2 0 0 0 0 0 1", &words[..7 * word.len() + 6])
        });
        let folders =
            [("tum", folder), ("replica", replica().keep()), ("7scenes", seven_scenes().keep())];
        put(&folders[1].1, "traj.txt", format!("{words}\n{IDENTITY}\n{IDENTITY}\n"));
        put(&folders[2].1, "frame-000000.pose.txt", &words);
        for (kind, folder) in &folders {
            let dataset = open(kind, folder).unwrap();
            let reason = dataset.no_pose(0).unwrap();
            assert!(reason.contains("expected finite numbers"), "{kind} {word}: {reason}");
        }
        folders[1..].iter().for_each(|(_, folder)| fs::remove_dir_all(folder).unwrap());
    }
}

#[test]
fn a_shared_camera_and_numbers_with_a_point_are_read() {
    let folder = replica();
    edit(folder.path(), "cam_params.json", |t| format!("\u{feff}{}", t.replace(":24,", ":24.0,")));
    edit(folder.path(), "instances.json", |text| text.replace("\"id\":1,", "\"id\":1.0,"));
    edit(folder.path(), "traj.txt", |text| text.replace(" 0 0 0 1\n", "\n"));
    let dataset = open("replica", folder.path()).unwrap();
    assert_eq!((dataset.intrinsics().width, dataset.no_pose(2)), (24, None));
    assert_eq!(dataset.truth().unwrap().instances()[0].id, 1);
    let scene = folder.path().join("room0");
    for name in ["results", "traj.txt"] {
        fs::create_dir_all(&scene).unwrap();
        fs::rename(folder.path().join(name), scene.join(name)).unwrap();
    }
    assert_eq!(open("replica", &scene).unwrap().intrinsics(), dataset.intrinsics());
    fs::remove_file(folder.path().join("cam_params.json")).unwrap();
    assert!(error("replica", &scene).contains("cannot read"), "control");
    edit(folder.path(), "instances.json", |text| text.replace("1.0", "1.5"));
    put(&scene, "cam_params.json", "{\"camera\":{\"w\":24.5}}");
    assert!(error("replica", &scene).contains("expected a whole number in range, found 24.5"));
}

/// Makes the pictures of a data set that have a name with `part` in it `size` large.
fn resize(folder: &Path, part: &str, size: (u32, u32)) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if name.contains(part) {
            let depth = name.contains("depth") || folder.ends_with("depth");
            let color = DynamicImage::new_rgb8(size.0, size.1);
            let blank = if depth { DynamicImage::new_luma16(size.0, size.1) } else { color };
            blank.save(&path).unwrap();
        }
    }
}

#[test]
fn a_camera_that_no_file_describes_is_told_of_or_refused() {
    for (name, fx, said) in [
        ("rgbd_dataset_freiburg3_office", 535.4, "the benchmark's freiburg3"),
        ("FR2-desk", 520.9, "the benchmark's freiburg2"),
        ("fr10_lab", 525.0, "a Kinect as its driver describes it"),
        ("nofr1", 525.0, "a Kinect as its driver describes it"),
    ] {
        let (keep, folder) = tum(name);
        fs::remove_file(folder.join("camera.txt")).unwrap();
        let refused = error("tum", &folder);
        assert!(refused.contains("expected camera.txt") && refused.contains("24x16"), "{refused}");
        ["rgb", "depth"].iter().for_each(|part| resize(&folder.join(part), "", (640, 480)));
        let dataset = open("tum", &folder).unwrap();
        assert_eq!(dataset.intrinsics().fx, fx, "{name}");
        let [note] = dataset.notes() else { panic!("{:?}", dataset.notes()) };
        assert!(note.contains(said) && note.contains("no camera.txt"), "{note}");
        #[cfg(unix)]
        {
            let link = keep.path().join("freiburg1_link");
            std::os::unix::fs::symlink(&folder, &link).unwrap();
            assert_eq!(open("tum", &link).unwrap().intrinsics().fx, 517.3, "a link's own name");
            let plain = keep.path().join("plain");
            std::os::unix::fs::symlink(&folder, &plain).unwrap();
            assert_eq!(open("tum", &plain).unwrap().intrinsics().fx, fx, "the name behind a link");
        }
        drop(keep);
    }
    let folder = seven_scenes();
    fs::remove_file(folder.path().join("camera-intrinsics.txt")).unwrap();
    assert!(error("7scenes", folder.path()).contains("expected camera-intrinsics.txt"));
    resize(folder.path(), ".png", (640, 480));
    let dataset = open("7scenes", folder.path()).unwrap();
    assert_eq!((dataset.intrinsics().fx, dataset.notes().len()), (585.0, 1));
}

#[test]
fn a_map_of_the_kinect_is_scored_against_the_pictures_that_are_sent() {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    let shades = |x: u32, y: u32| image::Rgb([(x / 4) as u8, (y / 4) as u8, 60]);
    RgbImage::from_fn(640, 480, shades).save(f.join("frame-000000.color.png")).unwrap();
    let depth = ImageBuffer::from_pixel(640, 480, Luma([2000_u16]));
    depth.save(f.join("frame-000000.depth.png")).unwrap();
    put(f, "frame-000000.pose.txt", IDENTITY);
    put(f, "camera-intrinsics.txt", "585 0 320\n0 585 240\n0 0 1\n");
    let color = |frame: RgbdFrame| image::load_from_memory(&frame.color.bytes).unwrap();
    let whole = SevenScenes::open(f).unwrap();
    let (sent, scored) = (whole.frame(0).unwrap(), whole.clean_frame(0).unwrap());
    assert_eq!(sent, scored);
    let raw = image::open(f.join("frame-000000.color.png")).unwrap();
    assert_ne!(color(sent), raw, "color is brought to the depth camera");
    // A part of a data set, too.
    let part = range(0, None, 1).of(Box::new(whole)).unwrap();
    assert_eq!(part.frame(0).unwrap(), part.clean_frame(0).unwrap());
}

#[test]
fn coefficients_behind_a_camera_are_its_distortion() {
    let (_keep, folder) = tum("office");
    let bent = Distortion::BrownConrady(vec![0.26, -0.95, 0.0, 0.01, 1.16]);
    for (more, distortion, notes) in [
        ("", Distortion::None, 0),
        ("0 0.0 0", Distortion::None, 0),
        ("0.26 -0.95 0 0.01 1.16", bent, 0),
        ("640 480", Distortion::None, 1),
        ("k1 0.26", Distortion::None, 1),
    ] {
        put(&folder, "camera.txt", format!("17 18 11.5 7.5 {more}"));
        let dataset = open("tum", &folder).unwrap();
        assert_eq!((dataset.intrinsics().fx, dataset.notes().len()), (17.0, notes), "{more}");
        assert_eq!(dataset.cameras().color.distortion, distortion, "{more}");
    }
    assert!(open("tum", &folder).unwrap().notes()[0].contains("is not used as a distortion"));
}

#[test]
fn one_damaged_picture_does_not_decide_about_the_others() {
    type Open = (&'static str, std::path::PathBuf, [&'static str; 2]);
    let (_keep, tum) = tum("office");
    let (replica, scenes) = (replica(), seven_scenes());
    let folders: [Open; 3] = [
        ("tum", tum, ["rgb/100.000000.png", "depth/100.010000.png"]),
        ("replica", replica.path().into(), ["results/frame000000.jpg", "results/depth000000.png"]),
        ("7scenes", scenes.path().into(), ["frame-000000.color.png", "frame-000000.depth.png"]),
    ];
    for (kind, folder, pictures) in &folders {
        let whole = open(kind, folder).unwrap();
        for picture in pictures {
            let bytes = fs::read(folder.join(picture)).unwrap();
            put(folder, picture, "");
            let dataset = open(kind, folder).unwrap();
            assert_eq!((dataset.len(), dataset.intrinsics()), (whole.len(), whole.intrinsics()));
            assert!(dataset.frame(1).is_ok(), "{kind} {picture}");
            put_color(folder, picture, (3, 5));
            assert_eq!(open(kind, folder).unwrap().intrinsics(), whole.intrinsics(), "{picture}");
            put(folder, picture, bytes);
        }
    }
}

#[test]
fn a_list_of_pairs_is_read_where_there_are_no_two_lists() {
    let (_keep, folder) = tum("living_room_traj2");
    let pairs = "0 depth/100.010000.png 0 rgb/100.000000.png\n2 depth/100.026000.png 2 rgb/100.033000.png\n";
    put(&folder, "associations.txt", pairs);
    put(&folder, "livingRoom2.gt.freiburg", "2 5 0 0 0 0 0 1\n");
    assert_eq!(open("tum", &folder).unwrap().len(), 3, "control: the two lists come first");
    fs::remove_file(folder.join("rgb.txt")).unwrap();
    fs::remove_file(folder.join("groundtruth.txt")).unwrap();
    let dataset = open("tum", &folder).unwrap();
    assert_eq!((dataset.len(), dataset.moment(1).unwrap().timestamp_nanos), (2, 2_000_000_000));
    assert!(dataset.no_pose(0).is_some());
    assert_eq!(dataset.moment(1).unwrap().world_from_camera.unwrap().translation.x, 5.0);
    assert_eq!(units(&dataset.frame(1).unwrap().depth)[(0, 0)][0], 5001);
    put(&folder, "associations.txt", "0 depth/100.010000.png 0\n");
    assert!(
        error("tum", &folder)
            .ends_with("associations.txt:1: expected timestamp, file, timestamp, file")
    );
}
