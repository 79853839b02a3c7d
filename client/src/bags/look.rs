//! What a recording holds, after one pass through its files.

use super::files::{FilePlace, Files};
use super::own::OwnFrames;
use super::store::Message;
use crate::dataset::DatasetError;
use crate::messages::{Decoder, Reading};
use crate::rig::Survey;
use std::collections::{BTreeMap, HashMap};

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
    decoders: HashMap<String, Option<Decoder>>,
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
        let mut look = Self::default();
        let problems = files.scan(|file, message| look.take(file, &message))?;
        look.problems = problems;
        look.problems.extend(look.damaged.iter().map(|(topic, (count, first))| {
            format!("{topic}: {count} messages are left out, the first: {first}")
        }));
        Ok(look)
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
        let place = (file, message.place);
        if self.own.take(message, place) {
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
        match decoder.read(message.data) {
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
