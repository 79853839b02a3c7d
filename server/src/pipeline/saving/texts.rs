//! Shared texts as a plain list.

use serde::{Deserialize as _, Deserializer, Serializer};
use std::sync::Arc;

pub(in super::super) fn serialize<S: Serializer>(
    texts: &Arc<[String]>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(texts.iter())
}

pub(in super::super) fn deserialize<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Arc<[String]>, D::Error> {
    Vec::deserialize(deserializer).map(Into::into)
}
