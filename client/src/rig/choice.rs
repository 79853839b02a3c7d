//! Choosing topics by what they hold.

use super::error::RigError;
use super::survey::{PictureSeen, Seen, Survey};
use super::wanted::Wanted;
use crate::messages::{Content, Kind};

/// The chosen topics.
#[derive(Clone, Debug)]
pub(super) struct Choice<'a> {
    pub color: Chosen<'a>,
    pub depth: Chosen<'a>,
    /// The calibration of the color camera.
    pub info: &'a str,
    /// The calibration of the depth camera, if there is one.
    pub depth_info: Option<&'a str>,
}

/// A topic of pictures.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chosen<'a> {
    pub topic: &'a str,
    pub picture: &'a PictureSeen,
    pub messages: u64,
}

/// Words in the names of topics that are not what a camera sees, or of another camera than the main one.
const ASIDE: [&str; 14] = [
    "confidence",
    "costmap",
    "debug",
    "detect",
    "disparity",
    "fisheye",
    "infra",
    "mask",
    "overlay",
    "right",
    "segment",
    "semantic",
    "thermal",
    "visual",
];

impl<'a> Choice<'a> {
    /// The topics of a survey that fit each other best, and those that are wanted.
    pub(super) fn of(survey: &'a Survey, wanted: &Wanted) -> Result<Self, RigError> {
        let colors = pictures(survey, "color", wanted.color.as_deref(), |c| c != Content::Depth)?;
        let depths = pictures(survey, "depth", wanted.depth.as_deref(), |c| c == Content::Depth)?;
        let infos = calibrations(survey);
        let most = colors.iter().chain(&depths).map(|chosen| chosen.messages).max().unwrap_or(0);
        let mut best: Option<(i64, Chosen<'a>, Chosen<'a>)> = None;
        for color in &colors {
            let has_info = info_of(color, &infos).is_some();
            for depth in &depths {
                let alone = color_score(color, most) + depth_score(depth, most);
                let score = alone + together(color, depth) + 40 * i64::from(has_info);
                if best.is_none_or(|(before, ..)| score > before) {
                    best = Some((score, *color, *depth));
                }
            }
        }
        let (_, color, depth) = best.expect("there is a topic of each");
        let named = |option, topic: Option<&str>| {
            topic.map(|topic| calibration(&infos, option, topic)).transpose()
        };
        let info = named("info", wanted.info.as_deref())?.or_else(|| info_of(&color, &infos));
        let Some(info) = info else { return Err(no_info(&color, &infos)) };
        let depth_info = named("depth_info", wanted.depth_info.as_deref())?;
        let depth_info = depth_info.or_else(|| info_of(&depth, &infos));
        Ok(Self { color, depth, info, depth_info })
    }
}

type Infos<'a> = Vec<(&'a str, &'a Seen)>;

/// Topics of pictures that may be used.
fn pictures<'a>(
    survey: &'a Survey,
    option: &'static str,
    wanted: Option<&str>,
    is_right: impl Fn(Content) -> bool,
) -> Result<Vec<Chosen<'a>>, RigError> {
    let all = survey.topics.iter().filter_map(|(topic, seen)| {
        let picture = seen.picture.as_ref().filter(|picture| is_right(picture.content))?;
        Some(Chosen { topic, picture, messages: seen.messages })
    });
    let all: Vec<Chosen> = all.collect();
    let names = || all.iter().map(|chosen| chosen.topic).collect::<Vec<_>>().join(", ");
    match wanted {
        Some(wanted) => {
            let found: Vec<Chosen> =
                all.iter().filter(|chosen| chosen.topic == wanted).copied().collect();
            if found.is_empty() {
                let expected = format!("a topic with {option} pictures ({})", or_none(names()));
                return Err(RigError::Wanted { option, value: wanted.to_owned(), expected });
            }
            Ok(found)
        }
        None if all.is_empty() => {
            let expected = format!("a topic with {option} pictures");
            Err(RigError::Missing { expected, found: described(survey) })
        }
        None => Ok(all),
    }
}

fn or_none(names: String) -> String {
    if names.is_empty() { "there is none".into() } else { names }
}

/// All topics with their schemas.
fn described(survey: &Survey) -> String {
    let all = survey.topics.iter().map(|(topic, seen)| {
        let schema = seen.decoder.schema();
        match &seen.problem {
            Some(problem) => format!("{topic} ({schema}: {problem})"),
            None => format!("{topic} ({schema}, {} messages)", seen.messages),
        }
    });
    let all = all.collect::<Vec<_>>().join(", ");
    if all.is_empty() { "no topic that can be read".into() } else { all }
}

fn calibrations(survey: &Survey) -> Infos<'_> {
    let all = survey.topics.iter().filter(|(_, seen)| seen.decoder.kind() == Kind::Calibration);
    all.filter(|(_, seen)| seen.calibration.is_some())
        .map(|(topic, seen)| (topic.as_str(), seen))
        .collect()
}

fn calibration<'a>(
    infos: &Infos<'a>,
    option: &'static str,
    wanted: &str,
) -> Result<&'a str, RigError> {
    let found = infos.iter().find(|(topic, _)| *topic == wanted);
    found.map(|(topic, _)| *topic).ok_or_else(|| {
        let names = infos.iter().map(|(topic, _)| *topic).collect::<Vec<_>>().join(", ");
        let expected = format!("a topic with calibrations ({})", or_none(names));
        RigError::Wanted { option, value: wanted.to_owned(), expected }
    })
}

fn no_info(color: &Chosen, infos: &Infos) -> RigError {
    let names = infos.iter().map(|(topic, _)| *topic).collect::<Vec<_>>().join(", ");
    RigError::Missing {
        expected: format!("a calibration (CameraInfo) beside {}, or info=TOPIC", color.topic),
        found: if names.is_empty() { "none".into() } else { names },
    }
}

/// The calibration beside a topic of pictures, or else one of its frame of coordinates.
fn info_of<'a>(pictures: &Chosen, infos: &Infos<'a>) -> Option<&'a str> {
    let mut folder = pictures.topic;
    // `/camera/color/image_raw/compressed` has its calibration at `/camera/color/camera_info`.
    for _ in 0..2 {
        folder = folder.rsplit_once('/').map_or("", |(folder, _)| folder);
        let beside = |topic: &str| {
            topic.rsplit_once('/').is_some_and(|(other, name)| {
                other == folder && (name == "camera_info" || name == "calibration")
            })
        };
        if let Some((topic, _)) =
            infos.iter().find(|(topic, _)| !folder.is_empty() && beside(topic))
        {
            return Some(topic);
        }
    }
    let is_same = |seen: &Seen| {
        let frame_id = seen.calibration.as_ref().map(|calibration| &calibration.frame_id);
        frame_id == Some(&pictures.picture.frame_id) && !pictures.picture.frame_id.is_empty()
    };
    infos.iter().find(|(_, seen)| is_same(seen)).map(|(topic, _)| *topic)
}

fn has(topic: &str, words: &[&str]) -> bool {
    let topic = topic.to_lowercase();
    words.iter().any(|word| topic.contains(word))
}

/// How likely a topic is of the main camera.
fn score(chosen: &Chosen, most: u64) -> i64 {
    let is_rare = chosen.messages < most / 4;
    // Raw pictures before the same ones compressed.
    let is_raw = !has(chosen.topic, &["compressed"]);
    i64::from(is_raw) - 60 * i64::from(has(chosen.topic, &ASIDE)) - 60 * i64::from(is_rare)
}

fn color_score(color: &Chosen, most: u64) -> i64 {
    let is_color = color.picture.content == Content::Color;
    score(color, most) - 60 * i64::from(has(color.topic, &["depth"]))
        + 100 * i64::from(is_color)
        + 10 * i64::from(has(color.topic, &["color", "rgb"]))
}

fn depth_score(depth: &Chosen, most: u64) -> i64 {
    score(depth, most) + 10 * i64::from(has(depth.topic, &["depth"]))
}

/// How well two topics fit each other.
fn together(color: &Chosen, depth: &Chosen) -> i64 {
    let (first, second) = (color.topic.split('/'), depth.topic.split('/'));
    let shared = first.zip(second).take_while(|(a, b)| a == b).count() as i64;
    let is_same_frame = color.picture.frame_id == depth.picture.frame_id;
    let is_same_size = color.picture.size == depth.picture.size;
    // Color of a side camera has its depth beside it.
    let is_beside = has(color.topic, &ASIDE) && has(depth.topic, &ASIDE);
    shared * 5
        + 60 * i64::from(is_beside)
        + 30 * i64::from(is_registered_by_name(depth.topic) && is_maybe_same_frame(color, depth))
        + 10 * i64::from(is_same_frame)
        + 5 * i64::from(is_same_size)
}

/// Whether two topics may be of one frame of coordinates: a topic may not name its frame.
pub(super) fn is_maybe_same_frame(one: &Chosen, other: &Chosen) -> bool {
    let (one, other) = (&one.picture.frame_id, &other.picture.frame_id);
    one == other || one.is_empty() || other.is_empty()
}

/// Whether a topic says that its depth was registered to color.
pub(super) fn is_registered_by_name(topic: &str) -> bool {
    has(topic, &["aligned", "registered", "depth_to_color", "depth_to_rgb", "depth2color"])
}

/// Whether the distortion of a topic's pictures was removed.
pub(super) fn is_rectified(topic: &str) -> bool {
    has(topic, &["image_rect", "rectified", "/rect/", "_rect_"])
}
