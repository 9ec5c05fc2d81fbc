//! Fields of a policy file, read in bounded memory: nothing is kept that is not checked.

use crate::wire::Bound;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::de::{self, Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;

/// Most numbers in all arrays of a file.
pub(super) const MAX_ELEMENTS: usize = 1 << 25;
const MAX_DIMENSIONS: usize = 8;
const MAX_ITEMS: usize = 64;
const MAX_BOUNDS: usize = 1 << 16;
/// Largest whole number below which every one has a `f64` of its own.
const MAX_WHOLE: f64 = 9_007_199_254_740_992.0;

/// An array of numbers, in row-major order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tensor {
    /// Its sizes.
    pub shape: Vec<usize>,
    /// Its elements.
    pub data: Vec<f32>,
}

#[derive(Deserialize)]
struct Encoded<'a> {
    #[serde(deserialize_with = "sizes")]
    shape: Vec<usize>,
    #[serde(borrow)]
    data: Cow<'a, str>,
}

impl<'de> Deserialize<'de> for Tensor {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let encoded = Encoded::deserialize(deserializer)?;
        decode(encoded).map_err(D::Error::custom)
    }
}

fn decode(encoded: Encoded<'_>) -> Result<Tensor, String> {
    let (shape, data) = (encoded.shape, encoded.data);
    let count = shape
        .iter()
        .try_fold(1_usize, |count, size| count.checked_mul(*size))
        .filter(|count| *count <= MAX_ELEMENTS)
        .ok_or_else(|| format!("shape {shape:?} is more than {MAX_ELEMENTS} numbers"))?;
    // The length is checked first, so that a wrong text costs no memory.
    if data.len() != (4 * count).div_ceil(3) * 4 {
        let expected = 4 * count;
        return Err(format!(
            "data: expected {expected} bytes in base64 for {shape:?}"
        ));
    }
    let bytes = STANDARD
        .decode(data.as_bytes())
        .map_err(|error| format!("data is not base64: {error}"))?;
    let (chunks, rest) = bytes.as_chunks::<4>();
    if chunks.len() != count || !rest.is_empty() {
        let (expected, got) = (4 * count, bytes.len());
        return Err(format!("data: expected {expected} bytes, got {got}"));
    }
    let data: Vec<_> = chunks
        .iter()
        .map(|chunk| f32::from_le_bytes(*chunk))
        .collect();
    match data.iter().position(|number| !number.is_finite()) {
        Some(index) => Err(format!("number {index} is not finite")),
        None => Ok(Tensor { shape, data }),
    }
}

/// A whole number, which may be spelt `60` or `60.0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Whole(pub u64);

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(WholeVisitor)
    }
}

struct WholeVisitor;

impl Visitor<'_> for WholeVisitor {
    type Value = Whole;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a whole number")
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Whole, E> {
        Ok(Whole(value))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Whole, E> {
        if value.fract() == 0.0 && (0.0..=MAX_WHOLE).contains(&value) {
            return Ok(Whole(value as u64));
        }
        Err(E::invalid_value(de::Unexpected::Float(value), &self))
    }
}

/// Reads a whole number.
pub(super) fn whole<'de, D: Deserializer<'de>>(deserializer: D) -> Result<usize, D::Error> {
    let Whole(value) = Whole::deserialize(deserializer)?;
    usize::try_from(value).map_err(D::Error::custom)
}

/// Reads a value that may be null, but not missing.
pub(super) fn nullable<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    Option::deserialize(deserializer)
}

/// Reads a list that never is long.
pub(super) fn few<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_seq(FewVisitor(PhantomData))
}

struct FewVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for FewVisitor<T> {
    type Value = Vec<T>;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "at most {MAX_ITEMS} items")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<T>, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = list.next_element()? {
            if items.len() == MAX_ITEMS {
                return Err(A::Error::invalid_length(MAX_ITEMS + 1, &self));
            }
            items.push(item);
        }
        Ok(items)
    }
}

/// Reads the sizes of a shape.
pub(super) fn sizes<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<usize>, D::Error> {
    deserializer.deserialize_seq(SizesVisitor)
}

struct SizesVisitor;

impl<'de> Visitor<'de> for SizesVisitor {
    type Value = Vec<usize>;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "at most {MAX_DIMENSIONS} sizes")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<usize>, A::Error> {
        let mut sizes = Vec::new();
        while let Some(Whole(size)) = list.next_element()? {
            if sizes.len() == MAX_DIMENSIONS {
                return Err(A::Error::invalid_length(MAX_DIMENSIONS + 1, &self));
            }
            sizes.push(usize::try_from(size).map_err(A::Error::custom)?);
        }
        Ok(sizes)
    }
}

/// Reads the bound of a component: a number, or one for each element.
pub(super) fn bound<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Bound>, D::Error> {
    deserializer.deserialize_any(BoundVisitor).map(Some)
}

struct BoundVisitor;

impl<'de> Visitor<'de> for BoundVisitor {
    type Value = Bound;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "a number, or at most {MAX_BOUNDS} of them")
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Bound, E> {
        Ok(Bound::All(value as f64))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Bound, E> {
        Ok(Bound::All(value as f64))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Bound, E> {
        Ok(Bound::All(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Bound, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = list.next_element()? {
            if values.len() == MAX_BOUNDS {
                return Err(A::Error::invalid_length(MAX_BOUNDS + 1, &self));
            }
            values.push(value);
        }
        Ok(Bound::Each(values))
    }
}
