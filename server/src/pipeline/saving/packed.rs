//! Arrays of numbers as one string of bytes, little-endian as in memory.

use bytemuck::Pod;
use serde::de::{Error, Visitor};
use serde::{Deserializer, Serializer};
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

/// An array of numbers.
pub(in super::super) trait Packed: Sized {
    type Item: Pod;
    fn items(&self) -> &[Self::Item];
    fn from_items(items: Vec<Self::Item>) -> Self;
}

impl<T: Pod> Packed for Vec<T> {
    type Item = T;

    fn items(&self) -> &[T] {
        self
    }

    fn from_items(items: Self) -> Self {
        items
    }
}

impl<T: Pod> Packed for Arc<[T]> {
    type Item = T;

    fn items(&self) -> &[T] {
        self
    }

    fn from_items(items: Vec<T>) -> Self {
        items.into()
    }
}

pub(in super::super) fn serialize<P: Packed, S: Serializer>(
    array: &P,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytemuck::cast_slice(array.items()))
}

pub(in super::super) fn deserialize<'de, P: Packed, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<P, D::Error> {
    deserializer.deserialize_bytes(Bytes(PhantomData))
}

struct Bytes<P>(PhantomData<P>);

impl<P: Packed> Visitor<'_> for Bytes<P> {
    type Value = P;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("bytes of whole numbers")
    }

    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<P, E> {
        if !bytes.len().is_multiple_of(size_of::<P::Item>()) {
            return Err(E::invalid_length(bytes.len(), &self));
        }
        Ok(P::from_items(bytemuck::pod_collect_to_vec(bytes)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::texts;
    use serde::{Deserialize, Serialize};
    use std::sync::Arc;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Arrays {
        #[serde(with = "super")]
        depths: Arc<[f32]>,
        #[serde(with = "super")]
        ids: Vec<u16>,
        #[serde(with = "texts")]
        texts: Arc<[String]>,
    }

    #[test]
    fn arrays_come_back_bit_for_bit() {
        let depths: Arc<[f32]> = [1.5, f32::MIN_POSITIVE, -0.0].into();
        let arrays = Arrays { depths, ids: vec![7, 65535], texts: ["a".into()].into() };
        let bytes = rmp_serde::to_vec_named(&arrays).unwrap();
        let back: Arrays = rmp_serde::from_slice(&bytes).unwrap();
        assert_eq!(back, arrays);
        assert!(back.depths[2].is_sign_negative());
    }

    #[test]
    fn a_part_of_a_number_is_an_error() {
        #[derive(Serialize)]
        struct Odd {
            #[serde(with = "super")]
            depths: Vec<u8>,
            #[serde(with = "super")]
            ids: Vec<u16>,
            #[serde(with = "texts")]
            texts: Arc<[String]>,
        }
        let odd = |bytes| Odd { depths: vec![0; bytes], ids: Vec::new(), texts: Vec::new().into() };
        let read = |odd: &Odd| {
            rmp_serde::from_slice::<Arrays>(&rmp_serde::to_vec_named(odd).unwrap()).is_ok()
        };
        assert!(read(&odd(8)) && !read(&odd(7)));
    }
}
