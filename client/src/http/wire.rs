//! What goes over HTTP, as JSON: the question, the answer, the map's status and its keyframes.
//! Scores are relevancies in 0..1; pixels; metres in the map's world. Only data: the requests are
//! in [`crate::http::HttpClient`].

use serde::{Deserialize, Serialize};

/// A question in plain words; without a view it is a 3D query.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Question {
    /// What is looked for; empty if there are several.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub text: String,
    /// Several texts, compared with each other.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub texts: Vec<String>,
    /// What it is not; empty: the server's own.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub negatives: Vec<String>,
    /// Answer for this view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view: Option<FrameView>,
    /// Relevancy above which something counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f32>,
    /// Side of the mean filter over the heat map, pixels; 0 is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<u32>,
    /// The most objects in the answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_objects: Option<usize>,
    /// 3D: objects nearest to this point first, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near: Option<[f32; 3]>,
    /// 3D: only what is in this box.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub within: Option<Bounds>,
}

/// An axis-aligned box, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// The least corner.
    pub min: [f32; 3],
    /// The greatest corner.
    pub max: [f32; 3],
}

impl Question {
    /// Where is it in space?
    pub fn in_space(text: &str) -> Self {
        Self { text: text.into(), ..Self::default() }
    }

    /// Where is it in the view of a tracked frame?
    pub fn in_frame(text: &str, sequence: u64) -> Self {
        Self { view: Some(FrameView { frame: sequence }), ..Self::in_space(text) }
    }
}

/// The view of a tracked frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FrameView {
    /// Its sequence.
    pub frame: u64,
}

/// What the map answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Name of this answer on the server.
    pub query_id: String,
    /// What was asked.
    pub text: String,
    /// Which map answered.
    pub map: String,
    /// Of which snapshot.
    pub revision: u64,
    /// Whether it is there.
    pub present: bool,
    /// How sure that is, 0 to 1.
    pub confidence: f32,
    /// Share of what was asked about that has been seen with language.
    pub coverage: f32,
    /// Relevancy above which something counted.
    pub threshold: f32,
    /// Where the relevancy of every pixel is; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heatmap: Option<HeatmapLink>,
    /// Pixels above the threshold; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<Rle>,
    /// One for each connected region, best first; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub boxes: Option<Vec<PixelBox>>,
    /// The most relevant pixel; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak: Option<Peak>,
    /// Where the points are; 3D queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<PointsLink>,
    /// Things in space, best first; 3D queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<Vec<Object>>,
    /// Where the time went.
    pub timing_ms: Timing,
}

/// Where the heat map is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeatmapLink {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// The least relevancy.
    pub min: f32,
    /// The greatest relevancy.
    pub max: f32,
    /// Path on the server.
    pub url: String,
}

/// Where the points are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointsLink {
    /// How many.
    pub count: usize,
    /// Path on the server.
    pub url: String,
}

/// A mask as COCO run lengths: column-major, starting with zeros.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rle {
    /// Height, width.
    pub size: [u32; 2],
    /// Lengths of runs.
    pub counts: Vec<u32>,
}

/// A box in pixels; x, y is its top-left corner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PixelBox {
    /// Left.
    pub x: f32,
    /// Top.
    pub y: f32,
    /// Pixels.
    pub width: f32,
    /// Pixels.
    pub height: f32,
    /// Relevancy of its best pixel.
    pub score: f32,
}

/// The most relevant pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peak {
    /// Column.
    pub x: f32,
    /// Row.
    pub y: f32,
    /// Its relevancy.
    pub score: f32,
}

/// A thing in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// Relevancy.
    pub score: f32,
    /// Middle of the oriented box, metres.
    pub center: [f32; 3],
    /// Sides of the oriented box, metres.
    pub size: [f32; 3],
    /// `world_from_box` as a quaternion (w, x, y, z).
    pub rotation: [f32; 4],
    /// Smallest corner of the axis-aligned box, metres.
    pub aabb_min: [f32; 3],
    /// Largest corner.
    pub aabb_max: [f32; 3],
    /// How many points it has.
    pub points: usize,
    /// From the asked point to the oriented box, metres; 0 inside.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<f32>,
}

/// Which of several texts is what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Segmentation {
    /// Name of this answer on the server.
    pub query_id: String,
    /// What was asked.
    pub texts: Vec<String>,
    /// Which map answered.
    pub map: String,
    /// Of which snapshot.
    pub revision: u64,
    /// Share of what was asked about that has been seen with language.
    pub coverage: f32,
    /// Relevancy that the best text had to exceed.
    pub threshold: f32,
    /// One for each text, in order.
    pub legend: Vec<LegendEntry>,
    /// Where the labels of the pixels are; view queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelsLink>,
    /// Where the labelled points are; 3D queries only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<PointsLink>,
    /// Where the time went.
    pub timing_ms: Timing,
}

/// What a label means.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LegendEntry {
    /// The value of its pixels; 0 is none of the texts.
    pub label: usize,
    /// The text.
    pub text: String,
    /// `#rrggbb`.
    pub color: String,
    /// The share of all pixels, or Gaussians, that have it.
    pub share: f32,
}

/// Where the labels are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LabelsLink {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Path on the server.
    pub url: String,
}

/// Where the server's time went, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Encoding the words.
    pub text: f32,
    /// Rendering codes.
    pub render: f32,
    /// Decoding them.
    pub decode: f32,
    /// Comparing.
    pub score: f32,
    /// All of it.
    pub total: f32,
}

/// A map in numbers.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Status {
    /// Increases with every snapshot.
    pub revision: u64,
    /// Frames that came.
    pub frames_received: u64,
    /// Frames with a pose.
    pub frames_tracked: u64,
    /// Frames without.
    #[serde(default)]
    pub frames_lost: u64,
    /// Frames accepted but never mapped.
    #[serde(default)]
    pub frames_dropped: u64,
    /// Frames in the map.
    pub keyframes: u64,
    /// Gaussians in the map.
    pub gaussians: u64,
    /// Device memory of the Gaussians.
    #[serde(default)]
    pub gpu_bytes: u64,
    /// Memory of the keyframes' pictures and codes.
    #[serde(default)]
    pub keyframe_bytes: u64,
    /// Frames that wait.
    pub queue_depth: u64,
    /// Nothing waits and the mapper has done its work on what it has.
    pub settled: bool,
    /// Why the map takes no more frames, if so.
    #[serde(default)]
    pub failure: Option<String>,
}

/// The server as it is.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct Health {
    /// What it renders on.
    pub adapter: String,
    /// Which networks it has.
    pub bundle: String,
    /// Its version.
    pub version: String,
}

/// Pinhole intrinsics, pixels; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct Camera {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length.
    pub fx: f64,
    /// Focal length.
    pub fy: f64,
    /// Principal point.
    pub cx: f64,
    /// Principal point.
    pub cy: f64,
}

/// A keyframe.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Keyframe {
    /// The sequence that the client gave it.
    pub sequence: u64,
    /// Row-major 4x4, metres.
    pub world_from_camera: [f64; 16],
    /// Its camera.
    pub camera: Camera,
    /// Whether its language is in the map.
    pub has_language: bool,
}

impl Keyframe {
    /// Where a point of the world is: pixel `(u, v)` and depth in metres, if it is in the picture.
    pub fn project(&self, point: [f64; 3]) -> Option<[f64; 3]> {
        let m = &self.world_from_camera;
        let offset: [f64; 3] = std::array::from_fn(|row| point[row] - m[row * 4 + 3]);
        // The inverse of a rotation is its transpose.
        let [x, y, z] = std::array::from_fn(|column| {
            (0..3).map(|row| m[row * 4 + column] * offset[row]).sum::<f64>()
        });
        let Camera { width, height, fx, fy, cx, cy } = self.camera;
        let (u, v) = (fx * x / z + cx, fy * y / z + cy);
        let inside = z > 0.0
            && (-0.5..f64::from(width) - 0.5).contains(&u)
            && (-0.5..f64::from(height) - 0.5).contains(&v);
        inside.then_some([u, v, z])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera at `at` that looks along the world's x with z up.
    fn keyframe(sequence: u64, at: [f64; 3]) -> Keyframe {
        let [x, y, z] = at;
        #[rustfmt::skip]
        let world_from_camera = [
            0.0, 0.0, 1.0, x,
            -1.0, 0.0, 0.0, y,
            0.0, -1.0, 0.0, z,
            0.0, 0.0, 0.0, 1.0,
        ];
        let camera = Camera { width: 65, height: 49, fx: 50.0, fy: 50.0, cx: 32.0, cy: 24.0 };
        Keyframe { sequence, world_from_camera, camera, has_language: true }
    }

    #[test]
    fn points_are_projected_or_outside() {
        let view = keyframe(0, [1.0, 2.0, 3.0]);
        assert_eq!(view.project([3.0, 2.0, 3.0]), Some([32.0, 24.0, 2.0]));
        // To the left of the camera and above it: left and above the middle.
        assert_eq!(
            view.project([3.0, 2.4, 3.2]).map(|p| p.map(f64::round)),
            Some([22.0, 19.0, 2.0])
        );
        assert_eq!(view.project([0.0, 2.0, 3.0]), None, "behind");
        assert_eq!(view.project([3.0, 5.0, 3.0]), None, "beside");
    }

    #[test]
    fn a_question_says_only_what_was_set() {
        let json = serde_json::to_string(&Question::in_frame("cup", 7)).unwrap();
        assert_eq!(json, r#"{"text":"cup","view":{"frame":7}}"#);
        assert_eq!(serde_json::to_string(&Question::in_space("cup")).unwrap(), r#"{"text":"cup"}"#);
    }
}
