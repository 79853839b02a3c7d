//! Keyframes as the tracker needs them. Which shows what the camera sees? Which looks like this
//! picture? For the second: small grey thumbnails, compared by correlation
//! (as PTAM's relocaliser, Klein and Murray 2008).
//!
//! In: pictures of keyframes. Out: the keyframes that look most like a lost frame. What a
//! thumbnail cannot know is decided by aligning: this only says where to start.

use super::super::working::Working;
use super::Tracked;
use lexsplat_gpu::Camera;
use nalgebra::{Isometry3, Point3};

const COLUMNS: usize = 40;
const ROWS: usize = 30;
/// 3x3 means, one after the other: about a Gaussian of 1.4 pixels.
const BLURS: usize = 3;
/// Points of a keyframe that tell how much of it a camera sees.
const SAMPLES: usize = 64;

/// A grey picture of 40x30, blurred, with mean 0 and length 1; zeros if it is all of one grey.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Thumbnail(Vec<f32>);

/// A keyframe as the tracker knows it.
pub(super) struct Place {
    /// The keyframe's frame.
    pub sequence: u64,
    /// Its pose.
    pub world_from_camera: Isometry3<f64>,
    /// (c, d): the map's intensity = exp(c) of the picture's + d.
    pub exposure: [f64; 2],
    /// Its picture, at the tracker's size.
    pub working: Working,
    thumbnail: Thumbnail,
    /// Some of its points, in its camera.
    points: Vec<Point3<f64>>,
}

/// All keyframes.
#[derive(Default)]
pub(super) struct Places {
    places: Vec<Place>,
}

impl Thumbnail {
    /// Of a picture.
    pub fn of(working: &Working) -> Self {
        let (width, height) = (working.camera.width as usize, working.camera.height as usize);
        let mut grey = vec![0.0; COLUMNS * ROWS];
        for (at, grey) in grey.iter_mut().enumerate() {
            let part = |index: usize, parts: usize, size: usize| {
                let first = (index * size / parts).min(size.saturating_sub(1));
                first..((index + 1) * size / parts).max(first + 1)
            };
            let columns = part(at % COLUMNS, COLUMNS, width);
            let (mut sum, mut count) = (0u32, 0u32);
            for y in part(at / COLUMNS, ROWS, height) {
                for x in columns.clone() {
                    let rgb = &working.rgb[3 * (y * width + x)..][..3];
                    sum += rgb.iter().map(|value| u32::from(*value)).sum::<u32>();
                    count += 3;
                }
            }
            *grey = sum as f32 / count.max(1) as f32;
        }
        for _ in 0..BLURS {
            grey = blurred(&grey);
        }
        let mean = grey.iter().sum::<f32>() / grey.len() as f32;
        grey.iter_mut().for_each(|value| *value -= mean);
        let length = grey.iter().map(|value| value * value).sum::<f32>().sqrt();
        // Below a grey level on average there is only noise.
        let scale = if length > (grey.len() as f32).sqrt() { 1.0 / length } else { 0.0 };
        grey.iter_mut().for_each(|value| *value *= scale);
        Self(grey)
    }

    /// Correlation, -1 to 1.
    pub fn likeness(&self, other: &Self) -> f32 {
        self.0.iter().zip(&other.0).map(|(a, b)| a * b).sum()
    }
}

impl Place {
    /// Share of the keyframe's points that a camera at `world_from_camera` has in its picture.
    fn overlap(&self, camera: &Camera, world_from_camera: &Isometry3<f64>) -> f64 {
        let camera_from_keyframe = world_from_camera.inverse() * self.world_from_camera;
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let is_inside = |point: &&Point3<f64>| {
            let p = camera_from_keyframe * **point;
            let u = f64::from(camera.fx) * p.x / p.z + f64::from(camera.cx);
            let v = f64::from(camera.fy) * p.y / p.z + f64::from(camera.cy);
            p.z > 0.0 && u >= 0.0 && v >= 0.0 && u < width && v < height
        };
        let inside = self.points.iter().filter(is_inside).count();
        inside as f64 / self.points.len().max(1) as f64
    }
}

impl Places {
    /// A keyframe was made.
    pub fn add(&mut self, sequence: u64, working: Working, tracked: &Tracked) {
        let thumbnail = Thumbnail::of(&working);
        let camera = Camera { camera_from_world: Isometry3::identity(), ..working.camera.clone() };
        let stride = (working.depth_metres.len() / SAMPLES).max(1);
        // Somewhere in the middle of each stretch, so that they do not stand in a column.
        let points = (0..working.depth_metres.len() / stride)
            .map(|i| i * stride + i * 7 % stride)
            .filter(|at| working.depth_metres[*at] > 0.0)
            .map(|at| {
                let (u, v) = (at % camera.width as usize, at / camera.width as usize);
                camera.unproject(u as f32, v as f32, working.depth_metres[at]).cast()
            })
            .collect();
        let Tracked { world_from_camera, exposure, .. } = *tracked;
        let place = Place { sequence, world_from_camera, exposure, working, thumbnail, points };
        self.places.push(place);
    }

    /// A keyframe was let go.
    pub fn forget(&mut self, sequence: u64) {
        self.places.retain(|place| place.sequence != sequence);
    }

    /// A keyframe was refined.
    pub fn correct(&mut self, sequence: u64, pose: Isometry3<f64>, exposure: [f64; 2]) {
        if let Some(place) = self.places.iter_mut().rev().find(|place| place.sequence == sequence) {
            (place.world_from_camera, place.exposure) = (pose, exposure);
        }
    }

    /// Keyframes to compare a frame with: the newest, and the oldest of those that show much of
    /// what a camera there sees: what is aligned with the past does not drift from it.
    pub fn around(
        &self,
        (camera, world_from_camera): (&Camera, &Isometry3<f64>),
        (count, overlap): (usize, f64),
    ) -> Vec<&Place> {
        let newest = self.places.last().into_iter();
        let older = self.places.iter().rev().skip(1).rev();
        let shows = |place: &&Place| place.overlap(camera, world_from_camera) >= overlap;
        newest.chain(older.filter(shows)).take(count).collect()
    }

    /// The keyframes that look most like the picture, best first.
    pub fn like(&self, thumbnail: &Thumbnail, count: usize) -> Vec<&Place> {
        let mut scored: Vec<(f32, &Place)> = self
            .places
            .iter()
            .map(|place| (place.thumbnail.likeness(thumbnail), place))
            .filter(|(likeness, _)| *likeness > 0.0)
            .collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        scored.into_iter().take(count).map(|(_, place)| place).collect()
    }
}

/// The mean of each pixel's 3x3 neighbours within the picture.
fn blurred(grey: &[f32]) -> Vec<f32> {
    (0..grey.len())
        .map(|at| {
            let (x, y) = (at % COLUMNS, at / COLUMNS);
            let (mut sum, mut count) = (0.0, 0.0);
            for y in y.saturating_sub(1)..(y + 2).min(ROWS) {
                for x in x.saturating_sub(1)..(x + 2).min(COLUMNS) {
                    sum += grey[y * COLUMNS + x];
                    count += 1.0;
                }
            }
            sum / count
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stripes of this many pixels, shifted, brighter by a factor.
    fn picture(stripe: usize, shift: usize, gain: f32) -> Working {
        let (width, height) = (160, 120);
        let camera = Camera {
            width: width as u32,
            height: height as u32,
            fx: 100.0,
            fy: 100.0,
            cx: 79.5,
            cy: 59.5,
            camera_from_world: Isometry3::identity(),
        };
        let grey = |at: usize| {
            let is_light = ((at % width + shift) / stripe).is_multiple_of(2);
            (gain * if is_light { 120.0 } else { 40.0 }) as u8
        };
        let rgb = (0..width * height).flat_map(|at| [grey(at); 3]).collect();
        Working { camera, rgb, depth_metres: vec![1.0; width * height].into() }
    }

    #[test]
    fn the_most_similar_keyframe_comes_first() {
        let mut places = Places::default();
        let at = |x: f64| Isometry3::translation(x, 0.0, 0.0);
        for (sequence, stripe) in [(1, 40), (2, 25), (3, 16)] {
            let tracked = Tracked {
                world_from_camera: at(sequence as f64),
                exposure: [0.0; 2],
                is_estimated: true,
                relocalised: false,
            };
            places.add(sequence, picture(stripe, 0, 1.0), &tracked);
        }
        let lost = Thumbnail::of(&picture(25, 2, 1.5));
        let first = |places: &Places, lost: &Thumbnail| {
            let like = places.like(lost, 1);
            (like[0].sequence, like[0].world_from_camera)
        };
        assert_eq!(first(&places, &lost), (2, at(2.0)), "a little further and brighter");
        assert_ne!(first(&places, &Thumbnail::of(&picture(40, 2, 1.0))).0, 2);
        places.correct(2, at(9.0), [0.0; 2]);
        assert_eq!(first(&places, &lost), (2, at(9.0)));
        places.forget(2);
        assert_ne!(first(&places, &lost).0, 2);
    }

    #[test]
    fn a_picture_of_one_grey_looks_like_nothing() {
        let grey = Thumbnail::of(&picture(1000, 0, 1.0));
        assert_eq!(grey.likeness(&grey), 0.0);
        let stripes = Thumbnail::of(&picture(25, 0, 1.0));
        assert!((stripes.likeness(&stripes) - 1.0).abs() < 1e-5);
    }
}
