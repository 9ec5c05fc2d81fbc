//! What agents see and decide, as Rust types.
//!
//! `#[derive(ObservationSpace)]` and `#[derive(ActionSpace)]` turn a struct into a space and a row: field names
//! become entry names, bounds come from attributes.

use crate::wire::ObservationEntry;
use crate::wire::{ActionComponent, ActionKind, ActionRow, ArrayLayout, Bound, DType};

pub use bevy_ludus_derive::{ActionSpace, ObservationSpace};

/// What an agent sees: named arrays of numbers.
///
/// ```
/// # use bevy_ludus::prelude::*;
/// #[derive(ObservationSpace)]
/// struct Seen {
///     /// Distances to walls; the entry "rays" of shape \[16\].
///     #[ludus(low = 0.0, high = 1.0)]
///     rays: [f32; 16],
///     /// The entry "picture" of shape \[8, 8, 3\].
///     picture: [[[u8; 3]; 8]; 8],
/// }
/// ```
///
/// A struct with the one field `observation` is a flat observation: trainers see an array, not a
/// dictionary. The compiler refuses other types:
///
/// ```compile_fail
/// # use bevy_ludus::prelude::*;
/// #[derive(ObservationSpace)]
/// struct Seen {
///     name: String,
/// }
/// ```
pub trait ObservationSpace: Send + Sync + 'static {
    /// Returns the entries, in the order in which [`ObservationSpace::write`] writes them.
    fn entries() -> Vec<ObservationEntry>;

    /// Returns the observation in which every number is zero.
    fn zero() -> Self;

    /// Writes all entries.
    fn write(&self, row: &mut RowWriter<'_>);
}

/// Nothing but what cameras see, or nothing at all.
impl ObservationSpace for () {
    fn entries() -> Vec<ObservationEntry> {
        Vec::new()
    }

    fn zero() -> Self {}

    fn write(&self, _row: &mut RowWriter<'_>) {}
}

/// What an agent decides: named choices and numbers.
///
/// ```
/// # use bevy_ludus::prelude::*;
/// #[derive(ActionSpace)]
/// struct Decision {
///     #[ludus(n = 4)]
///     weapon: u8,
///     is_jumping: bool,
///     #[ludus(low = -2.0, high = 2.0)]
///     steering: [f32; 2],
/// }
/// ```
///
/// An enum without fields is one choice among its variants, by itself (named "action") or as a
/// field of a struct. An integer must say how many alternatives it has:
///
/// ```compile_fail
/// # use bevy_ludus::prelude::*;
/// #[derive(ActionSpace)]
/// struct Decision {
///     weapon: u8,
/// }
/// ```
pub trait ActionSpace: Send + Sync + 'static {
    /// Returns the components, in the order in which [`ActionSpace::read`] reads them.
    fn components() -> Vec<ActionComponent>;

    /// Reads all components.
    fn read(row: &mut RowReader<'_>) -> Self;
}

/// Writes the observation of one agent into the arrays of its policy.
#[derive(Debug)]
pub struct RowWriter<'a> {
    bytes: &'a mut [u8],
    entries: std::slice::Iter<'a, ArrayLayout>,
    slot: usize,
}

impl<'a> RowWriter<'a> {
    /// Starts with the first entry of a slot.
    #[inline]
    #[must_use]
    pub fn new(bytes: &'a mut [u8], entries: &'a [ArrayLayout], slot: usize) -> Self {
        Self {
            bytes,
            entries: entries.iter(),
            slot,
        }
    }

    /// Writes the next entry; does nothing if there is none.
    #[inline]
    pub fn put<V: ObservationValue>(&mut self, value: &V) {
        if let Some(array) = self.entries.next() {
            value.write(&mut self.bytes[array.row(self.slot)]);
        }
    }
}

/// Reads the action of one agent.
#[derive(Debug)]
pub struct RowReader<'a> {
    row: ActionRow<'a>,
    num_choices: usize,
    num_numbers: usize,
}

impl<'a> RowReader<'a> {
    /// Starts with the first component.
    #[inline]
    #[must_use]
    pub fn new(row: ActionRow<'a>) -> Self {
        Self {
            row,
            num_choices: 0,
            num_numbers: 0,
        }
    }

    /// Reads the next choice.
    #[inline]
    pub fn choice(&mut self) -> i64 {
        self.num_choices += 1;
        self.row.choice(self.num_choices - 1)
    }

    /// Reads the next number.
    #[inline]
    pub fn number(&mut self) -> f32 {
        self.num_numbers += 1;
        self.row.number(self.num_numbers - 1)
    }
}

/// A number, or an array of such values.
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be an entry of an observation",
    note = "entries are f32, u8, i64, bool, or arrays of these, such as `[f32; 4]`"
)]
pub trait ObservationValue {
    /// Type of the numbers.
    const DTYPE: DType;
    /// Length of the value, bytes.
    const NUM_BYTES: usize;
    /// The value whose numbers are all zero.
    const ZERO: Self;

    /// Returns the shape; empty for a single number.
    fn shape() -> Vec<usize>;

    /// Writes the numbers, little-endian, row by row.
    fn write(&self, bytes: &mut [u8]);
}

macro_rules! single_number {
    ($type:ty, $dtype:expr, $zero:expr, $num_bytes:expr, $to_bytes:expr) => {
        impl ObservationValue for $type {
            const DTYPE: DType = $dtype;
            const NUM_BYTES: usize = $num_bytes;
            const ZERO: Self = $zero;

            fn shape() -> Vec<usize> {
                Vec::new()
            }

            #[inline]
            fn write(&self, bytes: &mut [u8]) {
                bytes.copy_from_slice(&$to_bytes(*self));
            }
        }
    };
}

single_number!(f32, DType::Float32, 0.0, 4, f32::to_le_bytes);
single_number!(u8, DType::Uint8, 0, 1, u8::to_le_bytes);
single_number!(i64, DType::Int64, 0, 8, i64::to_le_bytes);
single_number!(bool, DType::Uint8, false, 1, |value| [u8::from(value)]);

impl<V: ObservationValue, const N: usize> ObservationValue for [V; N] {
    const DTYPE: DType = V::DTYPE;
    const NUM_BYTES: usize = N * V::NUM_BYTES;
    const ZERO: Self = [V::ZERO; N];

    fn shape() -> Vec<usize> {
        let mut shape = vec![N];
        shape.extend(V::shape());
        shape
    }

    #[inline]
    fn write(&self, bytes: &mut [u8]) {
        // A length that the compiler knows lets it write many numbers at once.
        let bytes = &mut bytes[..Self::NUM_BYTES];
        for (value, part) in self.iter().zip(bytes.chunks_exact_mut(V::NUM_BYTES)) {
            value.write(part);
        }
    }
}

/// Describes the entry of a field; the derive macro calls this.
#[must_use]
pub fn entry<V: ObservationValue>(
    name: &str,
    low: Option<Bound>,
    high: Option<Bound>,
) -> ObservationEntry {
    let mut shape = V::shape();
    if shape.is_empty() {
        shape.push(1);
    }
    ObservationEntry {
        name: name.to_owned(),
        dtype: V::DTYPE,
        shape,
        low,
        high,
    }
}

/// A component of an action that needs no more than its type: numbers, a `bool`, or an enum that
/// derives [`ActionSpace`].
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be a component of an action",
    note = "components are f32 or [f32; N], bool, enums that derive ActionSpace, and integers that say \
            how many alternatives they have: `#[ludus(n = 4)]`"
)]
pub trait ActionPart {
    /// Describes the component.
    fn kind(low: Bound, high: Bound) -> ActionKind;

    /// Reads it.
    fn read(row: &mut RowReader<'_>) -> Self;
}

impl ActionPart for f32 {
    fn kind(low: Bound, high: Bound) -> ActionKind {
        ActionKind::Continuous { size: 1, low, high }
    }

    #[inline]
    fn read(row: &mut RowReader<'_>) -> Self {
        row.number()
    }
}

impl<const N: usize> ActionPart for [f32; N] {
    fn kind(low: Bound, high: Bound) -> ActionKind {
        ActionKind::Continuous {
            size: N as u64,
            low,
            high,
        }
    }

    #[inline]
    fn read(row: &mut RowReader<'_>) -> Self {
        [(); N].map(|()| row.number())
    }
}

impl ActionPart for bool {
    fn kind(_low: Bound, _high: Bound) -> ActionKind {
        ActionKind::Discrete { n: 2 }
    }

    #[inline]
    fn read(row: &mut RowReader<'_>) -> Self {
        row.choice() == 1
    }
}

/// An integer that holds a choice.
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot hold one of n alternatives",
    note = "use an integer type such as u8 or usize, or drop `n`"
)]
pub trait Choice {
    /// Takes the number of the chosen alternative.
    fn from_choice(choice: i64) -> Self;
}

macro_rules! choice {
    ($($type:ty),*) => {
        $(impl Choice for $type {
            #[inline]
            fn from_choice(choice: i64) -> Self {
                // Choices are checked before they are read, and their limit is 2²⁰.
                choice as Self
            }
        })*
    };
}

choice!(u8, u16, u32, u64, usize, i8, i16, i32, i64, isize);

/// Describes a component; the derive macro calls this.
#[must_use]
pub fn component(name: &str, kind: ActionKind) -> ActionComponent {
    ActionComponent {
        name: name.to_owned(),
        kind,
    }
}

impl From<f64> for Bound {
    fn from(value: f64) -> Self {
        Self::All(value)
    }
}

impl<const N: usize> From<[f64; N]> for Bound {
    fn from(values: [f64; N]) -> Self {
        Self::Each(values.to_vec())
    }
}
