//! Whether depth lies on the color image.
//!
//! In: edges of depth and of brightness of several frames. Out: the [`Placement`] of the depth picture on
//! the color image at which the edges of depth meet edges of brightness far better than where they are, in
//! nearly all frames; if there is one. Another camera's depth is enlarged and shifted; a phone's is turned.

use super::edges;
use super::small_frame::SmallFrame;
use serde::{Deserialize, Serialize};

/// Enlargements of the depth picture about its middle that are tried.
const SCALES: [f32; 18] =
    [1.0, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.05, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8];
/// Shifts are tried in steps of about this share of the width.
const STEP: f32 = 1.0 / 80.0;
/// So many steps to each side.
const STEPS: i32 = 4;
/// Edge pixels that a frame needs to take part.
const LEAST_EDGES: usize = 40;
/// Share of the edge pixels that must lie in the image at a placement.
const LEAST_INSIDE: f32 = 0.3;
/// Frames that a verdict needs.
const LEAST_FRAMES: usize = 8;
/// Frames after which no more are looked at.
const MOST_FRAMES: usize = 24;
/// A placement is right only if edges score better there than this; 0 is chance, 0.5 the best.
const GOOD: f32 = 0.1;
/// ... and what was sent loses this share of what the placement has above the mean of all.
const LOST: f32 = 0.3;
/// ... and it is better than what was sent in this share of the frames.
const WINS: f32 = 0.8;
/// A mean displacement below this share of the width is not worth a word.
const UNNOTICED: f32 = 0.012;
/// Mean distance of a pixel from the middle, as a share of the width.
const MEAN_DISTANCE: f32 = 0.3;

/// A place of the depth picture on the color image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    /// Quarter turns to the right, 0 to 3.
    pub turns: u8,
    /// Enlargement about the middle.
    pub scale: f32,
    /// Shift (right, down), shares of the width.
    pub shift: [f32; 2],
}

impl Placement {
    /// How far pixels are displaced in the mean, as a share of the width.
    pub fn displacement(&self) -> f32 {
        if self.turns > 0 {
            return 1.0;
        }
        self.shift[0].hypot(self.shift[1]) + (self.scale - 1.0).abs() * MEAN_DISTANCE
    }
}

/// A placement that fits better than what was sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Verdict {
    pub placement: Placement,
    /// Frames that were compared.
    pub frames: usize,
    /// Frames in which the placement fits better.
    pub won: usize,
}

/// Collects frames.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct RegistrationCheck {
    /// Scores of each frame at each placement; the first placement is what was sent.
    frames: Vec<Vec<f32>>,
    /// Columns of the pictures.
    width: usize,
}

impl RegistrationCheck {
    pub fn new() -> Self {
        Self { frames: Vec::new(), width: 0 }
    }

    /// Adds a frame, if it has edges.
    pub fn add(&mut self, frame: &SmallFrame) {
        let pixels = edges::of_depth(frame);
        if pixels.len() < LEAST_EDGES {
            return;
        }
        let (brightness, size) = (edges::of_brightness(frame), frame.size());
        let of_kind = |(turns, scale)| {
            let placed: Vec<_> =
                pixels.iter().map(|pixel| place(*pixel, turns, scale, size)).collect();
            let score = |[right, down]: [i32; 2]| score(&placed, right, down, &brightness, size);
            shifts(size.0).map(score).collect::<Vec<_>>()
        };
        if self.width != size.0 {
            // Shifts of pictures of another size are others.
            self.frames.clear();
            self.width = size.0;
        }
        self.frames.push(kinds().flat_map(of_kind).collect());
    }

    /// Whether enough frames had edges to see what is wrong.
    pub fn is_certain(&self) -> bool {
        self.frames.len() >= LEAST_FRAMES
    }

    /// Whether enough frames were seen.
    pub fn is_full(&self) -> bool {
        self.frames.len() >= MOST_FRAMES
    }

    /// The placement that fits better than what was sent.
    pub fn verdict(&self) -> Option<Verdict> {
        if !self.is_certain() {
            return None;
        }
        let frames = self.frames.len();
        let mean =
            |at: usize| self.frames.iter().map(|scores| scores[at]).sum::<f32>() / frames as f32;
        let scores: Vec<f32> = (0..self.frames[0].len()).map(mean).collect();
        let best = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
        let shifts: Vec<_> = shifts(self.width).collect();
        let (turns, scale) = kinds().nth(best / shifts.len())?;
        let shift = shifts[best % shifts.len()].map(|pixels| pixels as f32 / self.width as f32);
        let placement = Placement { turns, scale, shift };
        let usual = scores.iter().sum::<f32>() / scores.len() as f32;
        let won = self.frames.iter().filter(|scores| scores[best] > scores[0]).count();
        let is_better = scores[best] > GOOD
            && scores[best] - scores[0] > LOST * (scores[best] - usual)
            && won as f32 >= WINS * frames as f32
            && placement.displacement() > UNNOTICED;
        is_better.then_some(Verdict { placement, frames, won })
    }
}

/// All turns and scales that are tried; the first is none.
fn kinds() -> impl Iterator<Item = (u8, f32)> {
    SCALES.into_iter().map(|scale| (0, scale)).chain((1..4).map(|turns| (turns, 1.0)))
}

/// All shifts (right, down) in pixels that are tried; the first is none.
fn shifts(width: usize) -> impl Iterator<Item = [i32; 2]> {
    let step = (width as f32 * STEP).round().max(1.0) as i32;
    let along =
        move || std::iter::once(0).chain((1..=STEPS).flat_map(move |at| [at * step, -at * step]));
    along().flat_map(move |down| along().map(move |right| [right, down]))
}

/// The pixel on which a pixel of a turned and enlarged picture comes to lie.
fn place(
    [column, row]: [usize; 2],
    turns: u8,
    scale: f32,
    (width, height): (usize, usize),
) -> [i32; 2] {
    let last = [(width - 1) as f32, (height - 1) as f32];
    let (across, down) = (column as f32 / last[0] - 0.5, row as f32 / last[1] - 0.5);
    let turned = match turns {
        0 => [across, down],
        1 => [-down, across],
        2 => [-across, -down],
        _ => [down, -across],
    };
    [0, 1].map(|axis| ((turned[axis] * scale + 0.5) * last[axis]).round() as i32)
}

/// The mean rank of the brightness edges that edge pixels of depth meet; 0 is chance.
fn score(
    placed: &[[i32; 2]],
    right: i32,
    down: i32,
    brightness: &[f32],
    (width, height): (usize, usize),
) -> f32 {
    let (columns, rows) = (1..width as i32 - 1, 1..height as i32 - 1);
    let (mut sum, mut inside) = (0.0, 0_usize);
    for [column, row] in placed {
        let (column, row) = (column + right, row + down);
        if columns.contains(&column) && rows.contains(&row) {
            sum += brightness[row as usize * width + column as usize];
            inside += 1;
        }
    }
    if (inside as f32) < LEAST_INSIDE * placed.len() as f32 { 0.0 } else { sum / inside as f32 }
}
