//! Which keyframe does this picture look like? Small grey thumbnails, compared by correlation
//! (as PTAM's relocaliser, Klein and Murray 2008).
//!
//! In: pictures of keyframes. Out: the keyframes that look most like a lost frame. What a
//! thumbnail cannot know is decided by aligning: this only says where to start.

use super::super::working::Working;
use nalgebra::Isometry3;

const COLUMNS: usize = 40;
const ROWS: usize = 30;
/// 3x3 means, one after the other: about a Gaussian of 1.4 pixels.
const BLURS: usize = 3;

/// A grey picture of 40x30, blurred, with mean 0 and length 1; zeros if it is all of one grey.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Thumbnail(Vec<f32>);

/// A keyframe as the tracker knows it.
struct Place {
    sequence: u64,
    thumbnail: Thumbnail,
    world_from_camera: Isometry3<f64>,
}

/// All keyframes, by their thumbnails.
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

impl Places {
    /// A keyframe was made.
    pub fn add(&mut self, sequence: u64, working: &Working, world_from_camera: Isometry3<f64>) {
        let thumbnail = Thumbnail::of(working);
        self.places.push(Place { sequence, thumbnail, world_from_camera });
    }

    /// A keyframe's pose was refined.
    pub fn correct(&mut self, sequence: u64, world_from_camera: Isometry3<f64>) {
        if let Some(place) = self.places.iter_mut().rev().find(|place| place.sequence == sequence) {
            place.world_from_camera = world_from_camera;
        }
    }

    /// Poses of the keyframes that look most like the picture, best first.
    pub fn like(&self, thumbnail: &Thumbnail, count: usize) -> Vec<Isometry3<f64>> {
        let mut scored: Vec<(f32, &Place)> = self
            .places
            .iter()
            .map(|place| (place.thumbnail.likeness(thumbnail), place))
            .filter(|(likeness, _)| *likeness > 0.0)
            .collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        scored.iter().take(count).map(|(_, place)| place.world_from_camera).collect()
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
    use lexsplat_gpu::Camera;

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
        Working { camera, rgb, depth_metres: vec![1.0; width * height] }
    }

    #[test]
    fn the_most_similar_keyframe_comes_first() {
        let mut places = Places::default();
        let at = |x: f64| Isometry3::translation(x, 0.0, 0.0);
        for (sequence, stripe) in [(1, 40), (2, 25), (3, 16)] {
            places.add(sequence, &picture(stripe, 0, 1.0), at(sequence as f64));
        }
        let lost = Thumbnail::of(&picture(25, 2, 1.5));
        assert_eq!(places.like(&lost, 1), [at(2.0)], "a little further and brighter");
        assert_ne!(places.like(&Thumbnail::of(&picture(40, 2, 1.0)), 1), [at(2.0)]);
        places.correct(2, at(9.0));
        assert_eq!(places.like(&lost, 1), [at(9.0)]);
    }

    #[test]
    fn a_picture_of_one_grey_looks_like_nothing() {
        let grey = Thumbnail::of(&picture(1000, 0, 1.0));
        assert_eq!(grey.likeness(&grey), 0.0);
        let stripes = Thumbnail::of(&picture(25, 0, 1.0));
        assert!((stripes.likeness(&stripes) - 1.0).abs() < 1e-5);
    }
}
