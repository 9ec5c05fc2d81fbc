//! The network of a policy: what some agents see becomes outputs (POLICY.md §3).

use super::dense::Dense;
use super::gru::Gru;
use super::policy_model::{Normalisation, PolicyModel, is_image};
use super::vision::Vision;
use crate::wire::DType;

/// Agents that are computed together.
const BATCH: usize = 64;

/// A policy, packed for speed. It computes any number of agents at once; nothing is allocated unless
/// there are more of them than ever before.
///
/// ```no_run
/// # use bevy_ludus::model::{ActionHead, PolicyModel, PolicyNetwork};
/// # fn main() -> Result<(), bevy_ludus::model::PolicyFileError> {
/// let model = PolicyModel::load("hero.ludus.json".as_ref())?;
/// let (mut network, head) = (PolicyNetwork::new(&model), ActionHead::new(&model));
/// // One agent, one entry of two numbers.
/// let seen = [0.5_f32.to_le_bytes(), 1.0_f32.to_le_bytes()].concat();
/// let mut memory = vec![0.0; network.memory_size()];
/// let outputs = network.run(|_entry, _slot| &seen, &[0], &mut memory);
/// let (mut choices, mut numbers) = ([0], []);
/// head.choose(outputs, &[], None, &mut choices, &mut numbers);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct PolicyNetwork {
    vectors: Vec<Vector>,
    images: Vec<(usize, Vision)>,
    normalisation: Option<Normalisation>,
    memory: Option<Gru>,
    layers: Vec<Dense>,
    num_features: usize,
    num_outputs: usize,
    states: Vec<f32>,
    front: Vec<f32>,
    back: Vec<f32>,
    outputs: Vec<f32>,
}

/// An entry that is part of the joined vector.
#[derive(Clone, Copy, Debug)]
struct Vector {
    entry: usize,
    dtype: DType,
    size: usize,
}

impl PolicyNetwork {
    /// Packs a policy.
    #[must_use]
    pub fn new(model: &PolicyModel) -> Self {
        let inputs = model.inputs();
        let entries = || inputs.iter().enumerate();
        let vectors = entries().filter(|(_, entry)| !is_image(entry));
        let seen = entries().filter(|(_, entry)| is_image(entry));
        let images = seen.zip(&model.images);
        let layers: Vec<_> = model.layers.iter().map(Dense::new).collect();
        let num_features = model.num_features();
        let memory = model.memory.as_ref().map(|memory| Gru::new(memory, BATCH));
        let memory_size = memory.as_ref().map_or(0, |memory| memory.size);
        let widths = layers.iter().map(|layer| layer.outputs);
        let width = widths.fold(num_features.max(memory_size), usize::max);
        Self {
            vectors: vectors
                .map(|(index, entry)| Vector {
                    entry: index,
                    dtype: entry.dtype,
                    size: entry.size(),
                })
                .collect(),
            images: images
                .map(|((index, entry), image)| (index, Vision::new(image, entry)))
                .collect(),
            normalisation: model.normalisation.clone(),
            memory,
            layers,
            num_features,
            num_outputs: model.num_outputs(),
            states: vec![0.0; memory_size * BATCH],
            front: vec![0.0; width * BATCH],
            back: vec![0.0; width * BATCH],
            outputs: Vec::new(),
        }
    }

    /// Returns the number of elements of an agent's state; 0 without a memory.
    #[must_use]
    pub fn memory_size(&self) -> usize {
        self.memory.as_ref().map_or(0, |memory| memory.size)
    }

    /// Returns the number of outputs of an agent.
    #[must_use]
    pub fn num_outputs(&self) -> usize {
        self.num_outputs
    }

    /// Computes the outputs of the agents in some slots, `[slots, num_outputs]`.
    ///
    /// `row(entry, slot)` returns what the agent of a slot sees, in little-endian bytes: `entry` is
    /// the index in the policy's observation, and of a policy that looks at several frames these are
    /// all of them, as [`PolicyFrames`](super::PolicyFrames) has them. `memory` holds the states of all slots,
    /// `[n, memory_size]`, and moves on; set a row to zero when an episode begins.
    ///
    /// # Panics
    /// A row has fewer bytes than its entry, or `memory` lacks a slot.
    pub fn run<'a>(
        &mut self,
        row: impl Fn(usize, usize) -> &'a [u8],
        slots: &[usize],
        memory: &mut [f32],
    ) -> &[f32] {
        self.outputs.resize(slots.len() * self.num_outputs, 0.0);
        for (number, slots) in slots.chunks(BATCH).enumerate() {
            self.see(&row, slots);
            self.remember(slots, memory);
            self.decide(slots.len());
            let start = number * BATCH * self.num_outputs;
            let count = slots.len() * self.num_outputs;
            self.outputs[start..start + count].copy_from_slice(&self.front[..count]);
        }
        &self.outputs
    }

    /// Puts the features of some slots to the front.
    fn see<'a>(&mut self, row: &impl Fn(usize, usize) -> &'a [u8], slots: &[usize]) {
        let rows = self.front.chunks_exact_mut(self.num_features);
        for (slot, features) in slots.iter().zip(rows) {
            let mut start = 0;
            for vector in &self.vectors {
                let part = &mut features[start..start + vector.size];
                read_numbers(vector.dtype, row(vector.entry, *slot), part);
                start += vector.size;
            }
            if let Some(normalisation) = &self.normalisation {
                normalise(normalisation, &mut features[..start]);
            }
            for (entry, vision) in &mut self.images {
                let end = start + vision.num_features();
                vision.run(row(*entry, *slot), &mut features[start..end]);
                start = end;
            }
        }
    }

    /// Lets the memory, if there is one, take the place of the features.
    fn remember(&mut self, slots: &[usize], memory: &mut [f32]) {
        let Some(gru) = &mut self.memory else { return };
        let size = gru.size;
        let states = &mut self.states[..slots.len() * size];
        for (slot, state) in slots.iter().zip(states.chunks_exact_mut(size)) {
            state.copy_from_slice(&memory[slot * size..(slot + 1) * size]);
        }
        gru.advance(&self.front[..slots.len() * self.num_features], states);
        for (slot, state) in slots.iter().zip(states.chunks_exact(size)) {
            memory[slot * size..(slot + 1) * size].copy_from_slice(state);
        }
        self.front[..states.len()].copy_from_slice(states);
    }

    /// Runs all layers.
    fn decide(&mut self, count: usize) {
        for layer in &self.layers {
            let rows = &self.front[..count * layer.inputs];
            layer.run(rows, &mut self.back[..count * layer.outputs]);
            std::mem::swap(&mut self.front, &mut self.back);
        }
    }
}

fn read_numbers(dtype: DType, bytes: &[u8], numbers: &mut [f32]) {
    match dtype {
        DType::Float32 => {
            for (number, bytes) in numbers.iter_mut().zip(bytes.as_chunks().0) {
                *number = f32::from_le_bytes(*bytes);
            }
        }
        DType::Uint8 => {
            for (number, byte) in numbers.iter_mut().zip(bytes) {
                *number = f32::from(*byte);
            }
        }
        DType::Int64 => {
            for (number, bytes) in numbers.iter_mut().zip(bytes.as_chunks().0) {
                *number = i64::from_le_bytes(*bytes) as f32;
            }
        }
    }
}

fn normalise(normalisation: &Normalisation, vector: &mut [f32]) {
    let Normalisation {
        shift,
        scale,
        limit,
    } = normalisation;
    for ((x, shift), scale) in vector.iter_mut().zip(&shift.data).zip(&scale.data) {
        *x = ((*x - shift) * scale).clamp(-limit, *limit);
    }
}
