//! The messages of the log.

use async_nats::HeaderMap;
use lexsplat_proto::v1;
use prost::Message as _;
use prost::bytes::{Bytes, BytesMut};

/// What a message is: "open", "frame" or "close".
const KIND: &str = "Lexsplat-Kind";
/// Unique name of the message.
const ID: &str = "Lexsplat-Id";
/// Number of the part and of all parts, `2/3`.
const PART: &str = "Lexsplat-Part";
/// Log position of the message before, of the same map; 0 for the first.
const BEFORE: &str = "Lexsplat-Before";
/// Sequence of the newest frame that the log has as a whole, after this message.
const THROUGH: &str = "Lexsplat-Through";

/// What a robot sent.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) enum Record {
    /// A stream begins.
    Open(v1::OpenMap),
    /// An accepted frame.
    Frame(v1::Frame),
    /// The stream has ended.
    Close,
}

/// A record with its place in the log.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) struct Entry {
    pub record: Record,
    /// Log position of its first part.
    pub first: u64,
    /// Log position of its last part.
    pub last: u64,
}

/// The beginning of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Head {
    kind: String,
    pub id: String,
    part: usize,
    parts: usize,
    pub before: u64,
    pub through: Option<u64>,
}

impl Record {
    fn kind(&self) -> &'static str {
        match self {
            Self::Open(_) => "open",
            Self::Frame(_) => "frame",
            Self::Close => "close",
        }
    }

    fn bytes(&self) -> Bytes {
        match self {
            Self::Open(open) => open.encode_to_vec().into(),
            Self::Frame(frame) => frame.encode_to_vec().into(),
            Self::Close => Bytes::new(),
        }
    }

    fn decoded(kind: &str, bytes: &[u8]) -> Result<Self, String> {
        let failed = |error: prost::DecodeError| error.to_string();
        match kind {
            "open" => v1::OpenMap::decode(bytes).map(Self::Open).map_err(failed),
            "frame" => v1::Frame::decode(bytes).map(Self::Frame).map_err(failed),
            "close" => Ok(Self::Close),
            other => {
                Err(format!("a message of an unknown kind, {other:?}: it is of a newer version"))
            }
        }
    }
}

/// The messages of a record that is called `id`, each with at most `longest` bytes. `through`: the newest
/// frame before it. [`Head::before`] is not known yet.
pub(super) fn split(
    record: &Record,
    id: &str,
    through: Option<u64>,
    longest: usize,
) -> Vec<(Head, Bytes)> {
    let mut bytes = record.bytes();
    let parts = bytes.len().div_ceil(longest).max(1);
    let message = |part: usize| {
        let payload = bytes.split_to(longest.min(bytes.len()));
        let through = match record {
            Record::Frame(frame) if part == parts => Some(frame.sequence),
            _ => through,
        };
        let (kind, id) = (record.kind().to_owned(), format!("{id}/{part}"));
        (Head { kind, id, part, parts, before: 0, through }, payload)
    };
    (1..=parts).map(message).collect()
}

impl Head {
    pub(super) fn to_headers(&self) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(KIND, self.kind.as_str());
        headers.insert(ID, self.id.as_str());
        headers.insert(PART, format!("{}/{}", self.part, self.parts));
        headers.insert(BEFORE, self.before.to_string());
        if let Some(through) = self.through {
            headers.insert(THROUGH, through.to_string());
        }
        headers
    }

    /// # Errors
    /// The reason why these are no headers of the log.
    pub(super) fn of(headers: &HeaderMap) -> Result<Self, String> {
        let text = |name: &'static str| {
            headers.get(name).map(|value| value.as_str().to_owned()).ok_or(format!("no {name}"))
        };
        let number = |name: &'static str| -> Result<u64, String> {
            text(name)?.parse().map_err(|error| format!("{name}: {error}"))
        };
        let part = text(PART)?;
        let parts = part.split_once('/').and_then(|(part, parts)| {
            Some((part.parse::<usize>().ok()?, parts.parse::<usize>().ok()?))
        });
        let Some((part, parts)) = parts.filter(|(part, parts)| (1..=*parts).contains(part)) else {
            return Err(format!("{PART}: {part:?}"));
        };
        let through = headers.get(THROUGH).is_some().then(|| number(THROUGH)).transpose()?;
        let before = number(BEFORE)?;
        Ok(Self { kind: text(KIND)?, id: text(ID)?, part, parts, before, through })
    }
}

/// Puts the parts of records together.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    /// Kind, position of the first part, and parts so far.
    begun: Option<(String, u64, usize, BytesMut)>,
}

impl Assembly {
    /// Adds a message. Parts without the rest, whose writer died, are forgotten.
    ///
    /// # Errors
    /// The reason why the record cannot be read.
    pub(super) fn add(
        &mut self,
        head: &Head,
        payload: &[u8],
        position: u64,
    ) -> Result<Option<Entry>, String> {
        if head.part == 1 {
            self.begun = Some((head.kind.clone(), position, 0, BytesMut::new()));
        }
        let Some((kind, first, parts, mut bytes)) = self.begun.take() else { return Ok(None) };
        if kind != head.kind || parts + 1 != head.part {
            return Ok(None);
        }
        bytes.extend_from_slice(payload);
        if head.part < head.parts {
            self.begun = Some((kind, first, head.part, bytes));
            return Ok(None);
        }
        let record = Record::decoded(&kind, &bytes)?;
        Ok(Some(Entry { record, first, last: position }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(sequence: u64, bytes: usize) -> Record {
        let color: Vec<u8> = (0..bytes).map(|at| at as u8).collect();
        Record::Frame(v1::Frame { sequence, color: color.into(), ..v1::Frame::default() })
    }

    #[test]
    fn parts_are_put_together_again() {
        let record = frame(7, 1000);
        let messages = split(&record, "a", Some(6), 300);
        assert_eq!(messages.len(), 4);
        assert!(messages.iter().all(|(_, payload)| payload.len() <= 300));
        let throughs: Vec<_> = messages.iter().map(|(head, _)| head.through).collect();
        assert_eq!(throughs, [Some(6), Some(6), Some(6), Some(7)]);
        let mut assembly = Assembly::default();
        for (at, (head, payload)) in messages.iter().enumerate() {
            let head = Head::of(&head.to_headers()).unwrap();
            let entry = assembly.add(&head, payload, 10 + at as u64).unwrap();
            let expected = Entry { record: record.clone(), first: 10, last: 13 };
            assert_eq!(entry, (at == 3).then_some(expected));
        }
    }

    #[test]
    fn parts_without_the_rest_are_forgotten() {
        let (cut, whole) =
            (split(&frame(1, 900), "a", None, 300), split(&frame(1, 90), "b", None, 300));
        let mut assembly = Assembly::default();
        for (head, payload) in &cut[..2] {
            assert_eq!(assembly.add(head, payload, 1).unwrap(), None);
        }
        let (head, payload) = &whole[0];
        assert_eq!(assembly.add(head, payload, 3).unwrap().unwrap().record, frame(1, 90));
        // The end of a record whose beginning is gone.
        let (head, payload) = &cut[2];
        assert_eq!(assembly.add(head, payload, 4).unwrap(), None);
    }

    #[test]
    fn what_is_no_message_of_the_log_is_refused() {
        let headers = split(&Record::Close, "a", None, 300)[0].0.to_headers();
        assert_eq!(Head::of(&headers).unwrap().kind, "close");
        for (name, value) in [(PART, "2/1"), (PART, "x"), (BEFORE, "-1"), (THROUGH, "x")] {
            let mut wrong = headers.clone();
            wrong.insert(name, value);
            assert!(Head::of(&wrong).unwrap_err().contains(name));
        }
        assert!(Record::decoded("later", b"").unwrap_err().contains("newer version"));
    }
}
