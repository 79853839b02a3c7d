//! The declared order of modules of every crate of lexsplat.

use lexsplat_borders::order::Levels;

/// Which circles a crate may have.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Circles {
    /// None.
    Never,
    /// Only among files of one folder, the folder of a kernel.
    InsideOneFolder,
}

/// A crate with its order.
pub struct Declared {
    /// The source folder, relative to the root of the project.
    pub folder: &'static str,
    /// `lib.rs` or `main.rs`.
    pub root: &'static str,
    /// Lowest level first: a module may import modules of lower levels only.
    pub levels: &'static Levels<'static>,
    /// Which circles are allowed.
    pub circles: Circles,
}

/// Every crate but those for tests.
pub const CRATES: &[Declared] = &[
    Declared {
        folder: "proto/src",
        root: "lib.rs",
        levels: &[&["json"], &["lib"]],
        circles: Circles::Never,
    },
    Declared {
        folder: "gpu/src",
        root: "lib.rs",
        levels: &[
            &["device"],
            &["shader"],
            &["adapter", "primitives"],
            &["map"],
            &["pass"],
            &["track", "train"],
            &["lib"],
        ],
        circles: Circles::InsideOneFolder,
    },
    Declared {
        folder: "server/registration/src",
        root: "lib.rs",
        levels: &[&["intrinsics", "lens"], &["camera"], &["depth", "rectification"], &["lib"]],
        circles: Circles::Never,
    },
    Declared {
        folder: "server/src",
        root: "lib.rs",
        levels: &[
            &["file_watch", "query_id", "telemetry", "web"],
            &["pipeline/pose_covariance"],
            &[
                "pipeline/bilinear",
                "pipeline/exposure",
                "pipeline/frame_times",
                "pipeline/pose_adam",
                "pipeline/pose_graph",
                "pipeline/quantile",
                "pipeline/range",
                "pipeline/saving",
            ],
            &["net"],
            &["access"],
            &["pipeline/input_warning"],
            &["pipeline/frame"],
            &["pipeline/downsampled_frame"],
            &[
                "pipeline/backdrop",
                "pipeline/depth_gaps",
                "pipeline/features",
                "pipeline/registration",
                "pipeline/up",
            ],
            &["pipeline/input_check", "pipeline/network"],
            &["pipeline/compressor"],
            &["pipeline/srd"],
            &["pipeline/encoder"],
            &["pipeline/snapshot"],
            &["pipeline/keyframes"],
            &["pipeline/tracker"],
            &["pipeline/live_map"],
            &["pipeline/closure", "pipeline/mapper"],
            &["pipeline/query"],
            &["pipeline/checkpoint"],
            &["pipeline/map"],
            &["pipeline/map_thread"],
            &["pipeline/engine"],
            &["pipeline/mod"],
            &["export"],
            &["check"],
            &["store"],
            &["inspect", "maps"],
            &["ingest", "http"],
            &["config"],
            &["lib"],
        ],
        circles: Circles::Never,
    },
    Declared {
        folder: "server/src",
        root: "main.rs",
        levels: &[&["main"]],
        circles: Circles::Never,
    },
    Declared {
        folder: "client/src",
        root: "lib.rs",
        levels: &[
            &["access", "npy"],
            &["dataset/error", "dataset/frame", "dataset/name", "dataset/natural", "dataset/text"],
            &["dataset/decoded", "dataset/truth"],
            &["dataset/source"],
            &["dataset/layer"],
            &["dataset/against", "dataset/part"],
            &["dataset/posed"],
            &["dataset/files", "dataset/numbered", "dataset/kinect"],
            &["dataset/pose", "dataset/prepare"],
            &["dataset/described", "dataset/inspect"],
            &["dataset/recording"],
            &["dataset/inflate", "dataset/picture_files", "dataset/timed"],
            &[
                "dataset/folder",
                "dataset/nerfstudio",
                "dataset/r3d",
                "dataset/range",
                "dataset/replica",
                "dataset/scannet",
                "dataset/seven_scenes",
                "dataset/tum",
            ],
            &["dataset/mod"],
            &["messages"],
            &["rig"],
            &["bags"],
            &["http", "stream"],
            &["live"],
            &["lib"],
        ],
        circles: Circles::Never,
    },
    Declared {
        folder: "client/synthetic/src",
        root: "lib.rs",
        levels: &[
            &["vector"],
            &["noise", "surface"],
            &["prints"],
            &["material"],
            &["dice", "mesh"],
            &["bvh", "path", "places", "shapes"],
            &["light"],
            &["furniture"],
            &["layout"],
            &["camera"],
            &["scene"],
            &["render"],
            &["room", "encode", "shake"],
            &["dataset"],
            &["sensor", "write"],
            &["lib"],
        ],
        circles: Circles::Never,
    },
    Declared {
        folder: "client/evaluate/src",
        root: "lib.rs",
        levels: &[
            &[
                "clouds",
                "heatmap",
                "image_metrics",
                "lpips",
                "overlay",
                "stages",
                "statistics",
                "table",
                "trajectory",
            ],
            &["error", "options", "recorded", "score", "step"],
            &["context", "labels"],
            &["language", "presence", "views"],
            &["selection", "space"],
            &["samples", "words"],
            &["plot", "report"],
            &["run"],
            &["lib"],
        ],
        circles: Circles::Never,
    },
    Declared {
        folder: "client/cli/src",
        root: "main.rs",
        levels: &[
            &["files"],
            &[
                "access", "answer", "bench", "choices", "dataset", "progress", "runtime", "server",
                "waiting",
            ],
            &["sensing"],
            &["command/measure", "command/segment"],
            &["command"],
            &["main"],
        ],
        circles: Circles::Never,
    },
];
