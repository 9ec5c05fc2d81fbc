//! The last observations of agents whose policy looks at several together (POLICY.md §3.1).

use super::policy_model::PolicyModel;
use crate::wire::ObservationEntry;

/// What the agents in some slots have seen last, for [`PolicyNetwork::run`](super::PolicyNetwork::run).
#[derive(Clone, Debug)]
pub struct PolicyFrames {
    num_frames: usize,
    entries: Vec<Frames>,
    /// Whether a slot has seen nothing of its episode yet.
    is_first: Vec<bool>,
}

/// One entry: the bytes of all frames of all slots.
#[derive(Clone, Debug)]
struct Frames {
    frame_bytes: usize,
    bytes: Vec<u8>,
}

impl PolicyFrames {
    /// Keeps the frames of `num_slots` slots, in each of which an episode begins.
    #[must_use]
    pub fn new(model: &PolicyModel, num_slots: usize) -> Self {
        let sizes = model.observation.iter().map(ObservationEntry::row_bytes);
        let frames = |frame_bytes| Frames {
            frame_bytes,
            bytes: vec![0; frame_bytes * model.frames * num_slots],
        };
        Self {
            num_frames: model.frames,
            entries: sizes.map(frames).collect(),
            is_first: vec![true; num_slots],
        }
    }

    /// Begins the episode of a slot: its first observation takes the places of those before.
    ///
    /// # Panics
    /// There is no such slot.
    pub fn begin(&mut self, slot: usize) {
        self.is_first[slot] = true;
    }

    /// Takes what the agents in some slots see: `row(entry, slot)` returns its little-endian bytes.
    ///
    /// # Panics
    /// There is no such slot, or a row has another size than its entry.
    pub fn push<'a>(&mut self, row: impl Fn(usize, usize) -> &'a [u8], slots: &[usize]) {
        for (entry, frames) in self.entries.iter_mut().enumerate() {
            let (size, whole) = (frames.frame_bytes, frames.frame_bytes * self.num_frames);
            for slot in slots.iter().copied() {
                let (own, newest) = (&mut frames.bytes[slot * whole..][..whole], row(entry, slot));
                if self.is_first[slot] {
                    for frame in own.chunks_exact_mut(size) {
                        frame.copy_from_slice(newest);
                    }
                } else {
                    own.copy_within(size.., 0);
                    own[whole - size..].copy_from_slice(newest);
                }
            }
        }
        for slot in slots {
            self.is_first[*slot] = false;
        }
    }

    /// Returns all frames of an entry that the agent of a slot has seen, the oldest first.
    ///
    /// # Panics
    /// There is no such entry or slot.
    #[must_use]
    pub fn row(&self, entry: usize, slot: usize) -> &[u8] {
        let frames = &self.entries[entry];
        let whole = frames.frame_bytes * self.num_frames;
        &frames.bytes[slot * whole..][..whole]
    }
}
