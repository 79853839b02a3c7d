//! What a data set holds, and what is wrong with it.

use super::files;
use super::frame::{
    Camera, Cameras, ColorFormat, Depth, DepthCamera, DepthFormat, Distortion, Intrinsics,
    RgbdFrame,
};
use super::source::Dataset;
use super::text::shown;
use serde::Serialize;

/// Problems of one kind that are listed one by one.
const LISTED: usize = 5;
/// Frames whose depth is decoded.
const SAMPLES: usize = 9;
/// A camera that is carried does not move faster, metres per second.
const FASTEST: f64 = 5.0;
/// How far a principal point may be from the middle, of the picture's side.
const FARTHEST_CENTRE: f64 = 0.2;
/// Median depths of rooms and streets, metres.
const USUAL_METRES: std::ops::RangeInclusive<f64> = 0.15..=30.0;

/// What a data set holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// Its name; a map is called so.
    pub name: String,
    /// Frames that it has.
    pub frames: usize,
    /// Of these, frames that can be sent.
    pub readable: usize,
    /// Of these, frames with a pose: what is mapped if poses are given.
    pub with_pose: usize,
    /// Why the first frame without a pose has none.
    pub no_pose: Option<String>,
    /// Columns and rows of color, pixels.
    pub size: [u32; 2],
    /// fx, fy, cx, cy of color, pixels.
    pub camera: [f64; 4],
    /// Distortion of color; absent: none.
    pub distortion: Option<DistortionSeen>,
    /// Frames whose color camera is another one than the usual (autofocus).
    pub own_cameras: usize,
    /// The camera of depth; absent: depth is registered to color.
    pub depth_camera: Option<DepthCameraSeen>,
    /// Nearest and farthest depth that counts, metres; 0 and absent: the server's limits.
    pub depth_range_metres: Option<[f64; 2]>,
    /// Values of depth that are no measurement, beside 0.
    pub no_depth: Vec<u16>,
    /// Metres per unit of depth.
    pub depth_unit_metres: f64,
    /// Depth of a few frames; absent if none has any.
    pub depth: Option<DepthSeen>,
    /// Time from the first to the last frame, seconds.
    pub seconds: f64,
    /// Length of the camera's path, metres; absent without poses.
    pub metres: Option<f64>,
    /// Whether there is ground truth about objects.
    pub has_masks: bool,
    /// What was assumed because no file says it.
    pub assumed: Vec<String>,
    /// Reasons for frames that were left out when the data set was opened.
    pub left_out: Vec<String>,
    /// What is wrong; at most five of a kind one by one.
    pub problems: Vec<String>,
}

/// How a lens departs from a pinhole.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DistortionSeen {
    /// `brown_conrady` or `kannala_brandt`.
    pub model: &'static str,
    /// Coefficients in OpenCV's order.
    pub coefficients: Vec<f64>,
}

impl DistortionSeen {
    fn of(distortion: &Distortion) -> Option<Self> {
        let (model, coefficients) = match distortion {
            Distortion::None => return None,
            Distortion::BrownConrady(all) => ("brown_conrady", all.clone()),
            Distortion::KannalaBrandt(all) => ("kannala_brandt", all.to_vec()),
        };
        Some(Self { model, coefficients })
    }
}

/// The camera of depth, where it is not color's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DepthCameraSeen {
    /// Columns and rows of depth, pixels.
    pub size: [u32; 2],
    /// fx, fy, cx, cy of depth, pixels; absent: color's lens.
    pub camera: Option<[f64; 4]>,
    /// Distortion of depth; absent: none, or color's.
    pub distortion: Option<DistortionSeen>,
    /// Place of the depth camera in the color camera's coordinates (x right, y down, z forward), metres.
    pub place_metres: [f64; 3],
    /// By how much the depth camera is turned against color, degrees.
    pub turned_degrees: f64,
}

impl DepthCameraSeen {
    fn of(camera: &DepthCamera) -> Self {
        match camera {
            DepthCamera::SameLens { width, height } => Self {
                size: [*width, *height],
                camera: None,
                distortion: None,
                place_metres: [0.0; 3],
                turned_degrees: 0.0,
            },
            DepthCamera::Own { camera: Camera { intrinsics, distortion }, color_from_depth } => {
                let Intrinsics { width, height, fx, fy, cx, cy } = *intrinsics;
                Self {
                    size: [width, height],
                    camera: Some([fx, fy, cx, cy]),
                    distortion: DistortionSeen::of(distortion),
                    place_metres: color_from_depth.translation.vector.into(),
                    turned_degrees: color_from_depth.rotation.angle().to_degrees(),
                }
            }
        }
    }
}

/// Depth of a few frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DepthSeen {
    /// Share of the pixels with a measurement, 0 to 1.
    pub measured: f64,
    /// Median of the measurements, metres.
    pub median_metres: f64,
    /// A hundredth of the measurements is farther, metres.
    pub far_metres: f64,
}

/// Looks at every frame of a data set; calls `done` after each.
pub fn inspect(dataset: &dyn Dataset, mut done: impl FnMut(usize)) -> Inspection {
    let mut look = Look::new(dataset);
    for index in 0..dataset.len() {
        look.at(index);
        done(index + 1);
    }
    look.finished()
}

/// Problems of one kind.
#[derive(Default)]
struct Kind {
    count: usize,
    listed: Vec<String>,
}

impl Kind {
    fn add(&mut self, problem: String) {
        self.count += 1;
        if self.listed.len() < LISTED {
            self.listed.push(problem);
        }
    }

    fn told(self, what: &str) -> Vec<String> {
        let more = self.count - self.listed.len();
        let rest = (more > 0).then(|| format!("{more} more {what}"));
        self.listed.into_iter().chain(rest).collect()
    }
}

/// What was seen so far.
struct Look<'a> {
    dataset: &'a dyn Dataset,
    cameras: Cameras,
    own_cameras: usize,
    readable: usize,
    with_pose: usize,
    no_pose: Option<String>,
    /// Time and place of the frame before.
    before: Option<(u64, Option<[f64; 3]>)>,
    first_nanos: Option<u64>,
    metres: f64,
    metres_sampled: Vec<f64>,
    pixels_sampled: usize,
    unreadable: Kind,
    disordered: Kind,
    fast: Kind,
}

impl<'a> Look<'a> {
    fn new(dataset: &'a dyn Dataset) -> Self {
        Self {
            dataset,
            cameras: dataset.cameras(),
            own_cameras: 0,
            readable: 0,
            with_pose: 0,
            no_pose: None,
            before: None,
            first_nanos: None,
            metres: 0.0,
            metres_sampled: Vec::new(),
            pixels_sampled: 0,
            unreadable: Kind::default(),
            disordered: Kind::default(),
            fast: Kind::default(),
        }
    }

    fn at(&mut self, index: usize) {
        let sequence = self.dataset.sequence(index);
        let frame = match self.dataset.frame(index) {
            Ok(frame) => frame,
            Err(error) => {
                return self.unreadable.add(format!("frame {sequence}: {}", error.whole()));
            }
        };
        if let Err(reason) = self.check_pictures(index, &frame) {
            return self.unreadable.add(format!("frame {sequence}: {reason}"));
        }
        self.readable += 1;
        self.own_cameras += usize::from(frame.extras.intrinsics.is_some());
        match frame.world_from_camera {
            Some(_) => self.with_pose += 1,
            None => {
                let reason = || self.dataset.no_pose(index).unwrap_or("no frame has one");
                self.no_pose.get_or_insert_with(|| reason().to_owned());
            }
        }
        self.follow(sequence, &frame);
    }

    fn check_pictures(&mut self, index: usize, frame: &RgbdFrame) -> Result<(), String> {
        let Intrinsics { width, height, .. } = self.cameras.color.intrinsics;
        let (color, depth) = (&frame.color, &frame.depth);
        match color.format {
            ColorFormat::Rgb8 => check_length(&color.bytes, (width, height), 3),
            _ => check_size(&color.bytes, (width, height)),
        }
        .map_err(|reason| format!("color: {reason}"))?;
        let size = self.cameras.depth_size();
        match depth.format {
            DepthFormat::U16 => check_length(&depth.bytes, size, 2),
            DepthFormat::F32Metres => check_length(&depth.bytes, size, 4),
            DepthFormat::U16Zstd => Ok(()),
            DepthFormat::Png16 | DepthFormat::Unspecified => check_size(&depth.bytes, size),
        }
        .map_err(|reason| format!("depth: {reason}"))?;
        let is_sample = index.is_multiple_of(self.dataset.len().div_ceil(SAMPLES));
        if is_sample { self.sample(depth) } else { Ok(()) }
    }

    /// Adds the depths of a frame.
    fn sample(&mut self, depth: &Depth) -> Result<(), String> {
        let (unit, bytes) = (self.dataset.depth_unit_metres(), &depth.bytes);
        let short = |pair: &[u8]| u16::from_le_bytes([pair[0], pair[1]]);
        let units: Vec<u16> = match depth.format {
            DepthFormat::U16Zstd => return Ok(()),
            DepthFormat::U16 => bytes.chunks_exact(2).map(short).collect(),
            DepthFormat::F32Metres => {
                let float = |four: &[u8]| f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
                let metres = bytes.chunks_exact(4).map(|four| f64::from(float(four)));
                self.metres_sampled.extend(metres.filter(|metres| *metres > 0.0));
                self.pixels_sampled += bytes.len() / 4;
                return Ok(());
            }
            DepthFormat::Png16 | DepthFormat::Unspecified => {
                let decoded = image::load_from_memory(bytes).map_err(|e| format!("depth: {e}"))?;
                let image::DynamicImage::ImageLuma16(units) = decoded else {
                    return Err(format!(
                        "depth: expected 16-bit grey, found {:?}",
                        decoded.color()
                    ));
                };
                units.into_raw()
            }
        };
        let no_depth = &self.cameras.no_depth;
        let is_none = |units: u16| match &no_depth[..] {
            [] => matches!(units, 0 | u16::MAX),
            values => units == 0 || values.contains(&units),
        };
        let measured = units.iter().filter(|units| !is_none(**units));
        self.metres_sampled.extend(measured.map(|units| f64::from(*units) * unit));
        self.pixels_sampled += units.len();
        Ok(())
    }

    /// Compares a frame's time and place with the frame's before.
    fn follow(&mut self, sequence: u64, frame: &RgbdFrame) {
        let nanos = frame.timestamp_nanos;
        let place = frame.world_from_camera.map(|pose| pose.translation.vector.into());
        self.first_nanos.get_or_insert(nanos);
        if let Some((before, place_before)) = self.before.replace((nanos, place)) {
            if nanos <= before {
                self.disordered
                    .add(format!("frame {sequence}: its time is not later than the one before"));
                return;
            }
            let (Some(from), Some(to)) = (place_before, place) else { return };
            let way = (0..3).map(|i| f64::powi(to[i] - from[i], 2)).sum::<f64>().sqrt();
            let seconds = (nanos - before) as f64 / 1e9;
            self.metres += way;
            if way > FASTEST * seconds.max(0.2) {
                let moved = format!("the camera moves {way:.2} m in {seconds:.2} s");
                self.fast.add(format!("frame {sequence}: {moved}: is its pose right?"));
            }
        }
    }

    fn finished(mut self) -> Inspection {
        let Intrinsics { width, height, fx, fy, cx, cy } = self.cameras.color.intrinsics;
        let depth = self.depth();
        let mut problems = self.unreadable.told("frames that cannot be sent");
        problems.extend(self.disordered.told("frames whose time is not later"));
        problems.extend(self.fast.told("jumps"));
        problems.extend(depth_problem(depth, self.readable));
        problems.extend(lens_problem(&self.cameras.color.intrinsics));
        let last = self.before.map_or(0, |(nanos, _)| nanos);
        let seconds = last.saturating_sub(self.first_nanos.unwrap_or(last)) as f64 / 1e9;
        Inspection {
            name: self.dataset.name().to_owned(),
            frames: self.dataset.len(),
            readable: self.readable,
            with_pose: self.with_pose,
            no_pose: self.no_pose,
            size: [width, height],
            camera: [fx, fy, cx, cy],
            distortion: DistortionSeen::of(&self.cameras.color.distortion),
            own_cameras: self.own_cameras,
            depth_camera: self.cameras.depth.as_ref().map(DepthCameraSeen::of),
            depth_range_metres: self.cameras.depth_range_metres,
            no_depth: self.cameras.no_depth,
            depth_unit_metres: self.dataset.depth_unit_metres(),
            depth,
            seconds,
            metres: (self.with_pose > 0).then_some(self.metres),
            has_masks: self.dataset.truth().is_some(),
            assumed: self.dataset.notes().to_vec(),
            left_out: self.dataset.skipped().to_vec(),
            problems,
        }
    }

    fn depth(&mut self) -> Option<DepthSeen> {
        let all = &mut self.metres_sampled;
        if all.is_empty() {
            return None;
        }
        all.sort_by(f64::total_cmp);
        let at = |share: f64| all[(share * (all.len() - 1) as f64) as usize];
        let measured = all.len() as f64 / self.pixels_sampled as f64;
        Some(DepthSeen { measured, median_metres: at(0.5), far_metres: at(0.99) })
    }
}

/// A principal point that is not near the middle belongs to pictures of another size, or on their side.
fn lens_problem(camera: &Intrinsics) -> Option<String> {
    let Intrinsics { width, height, cx, cy, .. } = *camera;
    let off = |centre: f64, side: u32| (centre / f64::from(side) - 0.5).abs() > FARTHEST_CENTRE;
    (off(cx, width) || off(cy, height)).then(|| {
        let (cx, cy) = (shown(cx), shown(cy));
        format!(
            "the principal point {cx} {cy} is far from the middle of {width}x{height} pixels: is the camera \
             that of pictures of this size?"
        )
    })
}

fn depth_problem(depth: Option<DepthSeen>, readable: usize) -> Option<String> {
    match depth {
        None if readable > 0 => Some("no frame that was looked at has depth".into()),
        Some(DepthSeen { median_metres, .. }) if !USUAL_METRES.contains(&median_metres) => {
            Some(format!(
                "half of the depth is beyond {median_metres:.3} m: is the unit of depth right?"
            ))
        }
        _ => None,
    }
}

/// Refuses an encoded picture of another size.
fn check_size(bytes: &[u8], (width, height): (u32, u32)) -> Result<(), String> {
    let found = files::encoded_size(bytes)?;
    match (found.width, found.height) == (width, height) {
        true => Ok(()),
        false => Err(format!("expected {width}x{height} pixels, found {found}")),
    }
}

/// Refuses pixels that do not fill a picture.
fn check_length(bytes: &[u8], (width, height): (u32, u32), each: usize) -> Result<(), String> {
    let expected = width as usize * height as usize * each;
    match bytes.len() == expected {
        true => Ok(()),
        false => Err(format!(
            "expected {expected} bytes, which are {width}x{height} pixels, found {}",
            bytes.len()
        )),
    }
}
