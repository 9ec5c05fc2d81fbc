//! A trained policy as plain arrays: what a policy file holds (POLICY.md §1).

use super::fields::{self, Tensor, Whole};
use crate::wire::{ActionComponent, ActionKind, Bound, DType, ObservationEntry};
use serde::de::Error;
use serde::{Deserialize, Deserializer};

/// A non-linearity behind a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    /// *x*.
    None,
    /// tanh *x*.
    Tanh,
    /// max(*x*, 0).
    Relu,
    /// *x* where *x* > 0, otherwise eˣ − 1.
    Elu,
    /// *x* · σ(*x*).
    Silu,
}

/// A dense layer: *y* = activation(`weight` · *x* + `bias`).
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Linear {
    /// \[outputs, inputs\].
    pub weight: Tensor,
    /// \[outputs\].
    pub bias: Tensor,
    /// What follows it.
    pub activation: Activation,
}

/// A two-dimensional cross-correlation with zero padding.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Convolution {
    /// \[filters, channels, kernel height, kernel width\].
    pub weight: Tensor,
    /// \[filters\].
    pub bias: Tensor,
    /// Pixels between two applications, both ways.
    #[serde(deserialize_with = "fields::whole")]
    pub stride: usize,
    /// Zeros on each side, both ways.
    #[serde(deserialize_with = "fields::whole")]
    pub padding: usize,
    /// What follows it.
    pub activation: Activation,
}

/// The network of one image entry.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct ImageNetwork {
    /// Name of the entry.
    pub entry: String,
    /// In order.
    #[serde(deserialize_with = "fields::few")]
    pub convolutions: Vec<Convolution>,
    /// From the output of the last one.
    pub linear: Linear,
}

/// Kinds of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MemoryKind {
    /// A gated recurrent unit (Cho et al. 2014).
    Gru,
}

/// A memory; the rows of its arrays are those of the gates reset, update and new.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Memory {
    /// Which one.
    pub kind: MemoryKind,
    /// \[3 · size, inputs\].
    pub weight_input: Tensor,
    /// \[3 · size, size\].
    pub weight_hidden: Tensor,
    /// \[3 · size\].
    pub bias_input: Tensor,
    /// \[3 · size\].
    pub bias_hidden: Tensor,
}

impl Memory {
    /// Returns the number of elements of an agent's state.
    #[must_use]
    pub fn size(&self) -> usize {
        self.weight_hidden.shape.get(1).copied().unwrap_or(0)
    }
}

/// clip((*x* − `shift`) · `scale`, −`limit`, `limit`) of the joined vector.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Normalisation {
    /// \[V\].
    pub shift: Tensor,
    /// \[V\].
    pub scale: Tensor,
    /// Cut-off.
    pub limit: f32,
}

/// How outputs become actions (POLICY.md §4).
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Distribution {
    /// \[C\]; none: the network puts them out.
    #[serde(deserialize_with = "fields::nullable")]
    pub log_std: Option<Tensor>,
    /// Lowest and highest that the network puts out.
    pub log_std_range: [f32; 2],
    /// Whether tanh keeps numbers between −1 and 1; otherwise they are cut off there.
    pub is_squashed: bool,
}

/// A policy to run: observation in, action out.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct PolicyModel {
    /// Its name.
    pub policy: String,
    /// Hash of the spec it was trained for, for information.
    pub fingerprint: String,
    /// What it looks at, in order; bounds are not read.
    #[serde(deserialize_with = "entries")]
    pub observation: Vec<ObservationEntry>,
    /// What it decides, in order.
    #[serde(deserialize_with = "components")]
    pub action: Vec<ActionComponent>,
    /// Whether choices may be forbidden.
    pub has_action_mask: bool,
    /// Of the joined vector.
    #[serde(deserialize_with = "fields::nullable")]
    pub normalisation: Option<Normalisation>,
    /// In the order of the image entries.
    #[serde(deserialize_with = "fields::few")]
    pub images: Vec<ImageNetwork>,
    /// None without one.
    #[serde(deserialize_with = "fields::nullable")]
    pub memory: Option<Memory>,
    /// From features or memory to outputs.
    #[serde(deserialize_with = "fields::few")]
    pub layers: Vec<Linear>,
    /// From outputs to actions.
    pub distribution: Distribution,
    /// How many observations the network looks at together. Older files have one, and do not say so.
    #[serde(default = "one", deserialize_with = "fields::whole")]
    pub frames: usize,
}

fn one() -> usize {
    1
}

impl PolicyModel {
    /// Returns what the network looks at: all frames of each entry, the oldest first.
    #[must_use]
    pub fn inputs(&self) -> Vec<ObservationEntry> {
        let stack = |entry: &ObservationEntry| {
            let mut shape = vec![self.frames];
            match is_image(entry) {
                true => shape.extend(&entry.shape),
                false => shape.push(entry.size()),
            }
            ObservationEntry {
                shape,
                ..entry.clone()
            }
        };
        self.observation.iter().map(stack).collect()
    }

    /// Returns the number of elements of all frames of all entries but images.
    #[must_use]
    pub fn vector_size(&self) -> usize {
        let vectors = self.observation.iter().filter(|entry| !is_image(entry));
        vectors.map(ObservationEntry::size).sum::<usize>() * self.frames
    }

    /// Returns the number of elements of the joined vector and of the features of all images.
    #[must_use]
    pub fn num_features(&self) -> usize {
        let features = self.images.iter().map(|image| image.linear.bias.data.len());
        self.vector_size() + features.sum::<usize>()
    }

    /// Returns the number of alternatives of each choice.
    pub fn choices(&self) -> impl Iterator<Item = usize> + '_ {
        self.action.iter().filter_map(|part| match part.kind {
            ActionKind::Discrete { n } => Some(n as usize),
            ActionKind::Continuous { .. } => None,
        })
    }

    /// Returns the bounds of each number of an action.
    pub fn bounds(&self) -> impl Iterator<Item = (f32, f32)> + '_ {
        self.action.iter().flat_map(|part| {
            let (size, low, high) = match &part.kind {
                ActionKind::Discrete { .. } => (0, &Bound::All(0.0), &Bound::All(0.0)),
                ActionKind::Continuous { size, low, high } => (*size as usize, low, high),
            };
            let of = |bound: &Bound, element| bound.of(element).unwrap_or_default() as f32;
            (0..size).map(move |element| (of(low, element), of(high, element)))
        })
    }

    /// Returns the number of outputs: logits, means and, if they depend on the state, log
    /// deviations.
    #[must_use]
    pub fn num_outputs(&self) -> usize {
        let numbers = self.bounds().count();
        let deviations = if self.distribution.log_std.is_none() {
            numbers
        } else {
            0
        };
        self.choices().sum::<usize>() + numbers + deviations
    }
}

/// Returns whether convolutions look at an entry.
#[must_use]
pub fn is_image(entry: &ObservationEntry) -> bool {
    entry.dtype == DType::Uint8 && entry.shape.len() >= 3
}

#[derive(Deserialize)]
struct Entry {
    name: String,
    dtype: DType,
    #[serde(deserialize_with = "fields::sizes")]
    shape: Vec<usize>,
}

fn entries<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<ObservationEntry>, D::Error> {
    let found: Vec<Entry> = fields::few(deserializer)?;
    let entry = |entry: Entry| ObservationEntry {
        name: entry.name,
        dtype: entry.dtype,
        shape: entry.shape,
        low: None,
        high: None,
    };
    Ok(found.into_iter().map(entry).collect())
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Discrete,
    Continuous,
}

// All fields of both kinds, as serde would keep the whole of a tagged enum until it knows the tag.
#[derive(Deserialize)]
struct Component {
    name: String,
    kind: Kind,
    n: Option<Whole>,
    size: Option<Whole>,
    #[serde(default, deserialize_with = "fields::bound")]
    low: Option<Bound>,
    #[serde(default, deserialize_with = "fields::bound")]
    high: Option<Bound>,
}

fn components<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<ActionComponent>, D::Error> {
    let found: Vec<Component> = fields::few(deserializer)?;
    found.into_iter().map(component).collect()
}

fn component<E: Error>(found: Component) -> Result<ActionComponent, E> {
    let missing = |name| move || E::missing_field(name);
    let kind = match found.kind {
        Kind::Discrete => ActionKind::Discrete {
            n: found.n.ok_or_else(missing("n"))?.0,
        },
        Kind::Continuous => ActionKind::Continuous {
            size: found.size.ok_or_else(missing("size"))?.0,
            low: found.low.ok_or_else(missing("low"))?,
            high: found.high.ok_or_else(missing("high"))?,
        },
    };
    let name = found.name;
    Ok(ActionComponent { name, kind })
}
