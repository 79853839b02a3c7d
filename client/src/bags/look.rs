//! What a recording holds, after one pass through its files.

use super::compressed;
use super::files::{FilePlace, Files};
use super::own::OwnFrames;
use super::store::Message;
use crate::dataset::DatasetError;
use crate::messages::{Decoder, Kind, Reading};
use crate::rig::Survey;
use std::collections::{BTreeMap, HashMap};

/// Bytes of messages that are read and remembered; the rest is left out, since it would fill the memory. An
/// hour of a robot's transforms and accelerometers has a quarter of it.
const MOST: u64 = 2 << 30;
/// What the place of a message takes, bytes.
const PLACE: u64 = 64;

/// What a recording holds.
#[derive(Default)]
pub(super) struct Look {
    pub survey: Survey,
    /// Pictures by topic, in the order of the files.
    pub pictures: HashMap<String, Vec<Met>>,
    /// Frames of lexsplat's own recordings.
    pub own: OwnFrames,
    /// What is wrong with the files, in words.
    pub problems: Vec<String>,
    /// Bytes of messages that may still be remembered.
    left: u64,
    /// Number of messages behind them.
    left_out: u64,
    decoders: HashMap<String, Option<Decoder>>,
    /// The message that was decompressed last.
    space: Vec<u8>,
    /// Encodings and schemas of topics that are not read.
    unread: BTreeMap<String, String>,
    /// Number of damaged messages, and the first error, by topic.
    damaged: BTreeMap<String, (usize, String)>,
}

/// A picture in a recording.
#[derive(Clone, Copy, Debug)]
pub(super) struct Met {
    /// When it was taken, nanoseconds.
    pub nanos: u64,
    pub place: FilePlace,
}

impl Look {
    /// Goes through all files once.
    ///
    /// # Errors
    /// [`DatasetError`] if nothing can be read.
    pub(super) fn through(files: &Files) -> Result<Self, DatasetError> {
        Self::up_to(files, MOST)
    }

    /// The same, where so many bytes of messages are remembered.
    pub(super) fn up_to(files: &Files, left: u64) -> Result<Self, DatasetError> {
        let mut look = Self { left, ..Self::default() };
        let problems = files.scan(|file, message| look.take(file, &message))?;
        look.problems = problems;
        if look.left_out > 0 {
            look.problems.push(format!(
                "{} messages at the end are left out: split the recording",
                look.left_out
            ));
        }
        look.problems.extend(look.damaged.iter().map(|(topic, (count, first))| {
            format!("{topic}: {count} messages are left out, the first: {first}")
        }));
        Ok(look)
    }

    /// Counts a message. Of a picture only its place is remembered.
    fn spend(&mut self, message: &Message<'_>) {
        let decoder = Decoder::of(&message.channel.encoding, &message.channel.schema);
        let is_picture = decoder.is_some_and(|decoder| decoder.kind() == Kind::Picture);
        let bytes = if is_picture { 0 } else { message.data.len() as u64 };
        self.left = self.left.saturating_sub(PLACE + bytes);
    }

    /// The topics that are not read, in words; empty if there are none.
    pub(super) fn unread(&self) -> String {
        let all = self.unread.iter().map(|(topic, what)| format!("{topic} ({what})"));
        all.collect::<Vec<_>>().join(", ")
    }

    /// The topics with pictures that are not read, in words; empty if there are none.
    pub(super) fn unread_pictures(&self) -> String {
        let has_pictures =
            |what: &str| ["Image", "Video", "FFMPEG"].iter().any(|n| what.contains(n));
        let all = self.unread.iter().filter(|(_, what)| has_pictures(what));
        all.map(|(topic, what)| format!("{topic} ({what})")).collect::<Vec<_>>().join(", ")
    }

    fn take(&mut self, file: usize, message: &Message<'_>) {
        if self.left == 0 {
            self.left_out += 1;
            return;
        }
        let place = (file, message.place);
        if self.own.take(message, place) {
            self.spend(message);
            return;
        }
        let channel = message.channel;
        let known = self.decoders.get(&channel.topic).copied();
        let decoder = known.unwrap_or_else(|| {
            let decoder = Decoder::of(&channel.encoding, &channel.schema);
            match decoder {
                Some(decoder) => self.survey.add(&channel.topic, decoder),
                None => {
                    let what = format!("{} in {}", channel.schema, channel.encoding);
                    self.unread.insert(channel.topic.clone(), what);
                }
            }
            self.decoders.insert(channel.topic.clone(), decoder);
            decoder
        });
        let Some(decoder) = decoder else { return };
        self.spend(message);
        match compressed::read(decoder, message.data, &mut self.space) {
            Ok(reading) => {
                let reading = reading.received(message.nanos);
                if let Reading::Picture(picture) = &reading {
                    let met = Met { nanos: picture.nanos, place };
                    self.pictures.entry(channel.topic.clone()).or_default().push(met);
                }
                self.survey.take(&channel.topic, reading);
            }
            Err(error) => {
                self.survey.damaged(&channel.topic, error.to_string());
                let damaged = self.damaged.entry(channel.topic.clone());
                damaged.or_insert_with(|| (0, error.to_string())).0 += 1;
            }
        }
    }
}
