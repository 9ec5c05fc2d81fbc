//! `BATCH` payloads as structures of arrays, written in place (PROTOCOL.md §7).

use super::{FrameType, HEADER_BYTES, PolicySpec, Spec, WireError, encode_header, padded};
use std::ops::Range;

const HEAD_BYTES: usize = 24;
const FINAL_HEAD_BYTES: usize = 8;
/// Bit of the flags: the answer to a `RESET`.
pub const FLAG_RESET: u32 = 1;
/// Bit of the flags: the game has requests.
pub const FLAG_REQUESTS: u32 = 2;

/// The numbers at the beginning of a `BATCH`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BatchHead {
    /// Ticks simulated since the engine started.
    pub tick: u64,
    /// Time in the game, microseconds.
    pub engine_us: u32,
    /// Time in the add-on, microseconds.
    pub bridge_us: u32,
    /// Time the engine waited for the request, microseconds.
    pub wait_us: u32,
    /// [`FLAG_RESET`] and [`FLAG_REQUESTS`].
    pub flags: u32,
}

impl BatchHead {
    fn encode(self) -> [u8; HEAD_BYTES] {
        let mut bytes = [0; HEAD_BYTES];
        bytes[..8].copy_from_slice(&self.tick.to_le_bytes());
        let words = [self.engine_us, self.bridge_us, self.wait_us, self.flags];
        for (chunk, word) in bytes[8..].as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *chunk = word.to_le_bytes();
        }
        bytes
    }

    fn decode(bytes: [u8; HEAD_BYTES]) -> Self {
        let (words, _) = bytes.as_chunks::<4>();
        let word = |index: usize| u32::from_le_bytes(words[index]);
        Self {
            tick: u64::from(word(1)) << 32 | u64::from(word(0)),
            engine_us: word(2),
            bridge_us: word(3),
            wait_us: word(4),
            flags: word(5),
        }
    }
}

/// Where an array lies in a frame: one row per slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArrayLayout {
    /// Offset of its first byte in the frame.
    pub start: usize,
    /// Length of one slot's row, bytes.
    pub row_bytes: usize,
}

impl ArrayLayout {
    /// Returns where the row of a slot lies.
    #[inline]
    #[must_use]
    pub fn row(self, slot: usize) -> Range<usize> {
        let start = self.start + slot * self.row_bytes;
        start..start + self.row_bytes
    }

    /// Returns where the rows of some slots lie.
    #[must_use]
    pub fn rows(self, slots: Range<usize>) -> Range<usize> {
        self.start + slots.start * self.row_bytes..self.start + slots.end * self.row_bytes
    }
}

/// Where the arrays of one policy lie in a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PolicyArrays {
    /// Slots of the policy.
    pub num_agents: usize,
    /// Observation entries, in the order of the spec.
    pub entries: Vec<ArrayLayout>,
    /// Rewards, `f32`.
    pub reward: ArrayLayout,
    /// Whether each episode has ended, `u8`.
    pub terminated: ArrayLayout,
    /// Whether each episode was cut off, `u8`.
    pub truncated: ArrayLayout,
    /// Whether each slot acts on the observation of this frame, `u8`.
    pub active: ArrayLayout,
    /// What each slot may choose, `u8`; rows of length 0 without masks.
    pub mask: ArrayLayout,
}

impl PolicyArrays {
    fn new(policy: &PolicySpec, cursor: &mut usize) -> Self {
        let num_agents = policy.num_agents as usize;
        let mut array = |row_bytes: usize| {
            let start = *cursor;
            *cursor += padded(num_agents * row_bytes);
            ArrayLayout { start, row_bytes }
        };
        Self {
            num_agents,
            entries: policy
                .observation
                .iter()
                .map(|entry| array(entry.row_bytes()))
                .collect(),
            reward: array(4),
            terminated: array(1),
            truncated: array(1),
            active: array(1),
            mask: array(policy.mask_size()),
        }
    }

    /// Returns all arrays, in wire order.
    pub fn all(&self) -> impl Iterator<Item = ArrayLayout> + '_ {
        let rest = [
            self.reward,
            self.terminated,
            self.truncated,
            self.active,
            self.mask,
        ];
        self.entries.iter().copied().chain(rest)
    }

    fn final_bytes(&self, num_final: usize) -> usize {
        let entries = self
            .entries
            .iter()
            .map(|entry| padded(num_final * entry.row_bytes));
        FINAL_HEAD_BYTES + padded(num_final * 4) + entries.sum::<usize>()
    }
}

/// Where everything lies in the part of a `BATCH` whose length is always the same.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BatchLayout {
    /// In the order of the spec.
    pub policies: Vec<PolicyArrays>,
    /// Length of the header and of all arrays, without final observations.
    pub fixed_bytes: usize,
}

impl BatchLayout {
    /// Lays out the batches of a spec.
    #[must_use]
    pub fn new(spec: &Spec) -> Self {
        let mut fixed_bytes = HEADER_BYTES + HEAD_BYTES;
        let arrays = |policy| PolicyArrays::new(policy, &mut fixed_bytes);
        Self {
            policies: spec.policies.iter().map(arrays).collect(),
            fixed_bytes,
        }
    }

    /// Returns the length of the payload in which all agents end.
    #[must_use]
    pub fn max_bytes(&self) -> usize {
        let finals = self
            .policies
            .iter()
            .map(|policy| policy.final_bytes(policy.num_agents));
        self.fixed_bytes - HEADER_BYTES + finals.sum::<usize>()
    }
}

/// What agents saw when their episodes ended.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FinalRows {
    /// Their slots, ascending.
    pub slots: Vec<u32>,
    /// One array per entry, with one row per slot.
    pub entries: Vec<Vec<u8>>,
}

impl FinalRows {
    fn new(policy: &PolicyArrays) -> Self {
        Self {
            slots: Vec::new(),
            entries: vec![Vec::new(); policy.entries.len()],
        }
    }

    /// Forgets all rows, and keeps the memory.
    pub fn clear(&mut self) {
        self.slots.clear();
        self.entries.iter_mut().for_each(Vec::clear);
    }

    fn append_to(&self, frame: &mut Vec<u8>) {
        frame.extend_from_slice(&(self.slots.len() as u64).to_le_bytes());
        let start = frame.len();
        frame.resize(start + padded(self.slots.len() * 4), 0);
        let (words, _) = frame[start..].as_chunks_mut::<4>();
        for (word, slot) in words.iter_mut().zip(&self.slots) {
            *word = slot.to_le_bytes();
        }
        for entry in &self.entries {
            frame.extend_from_slice(entry);
            pad(frame);
        }
    }
}

fn pad(frame: &mut Vec<u8>) {
    frame.resize(padded(frame.len()), 0);
}

/// One `BATCH`, used again for every step: rows are written where they are sent from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BatchFrame {
    layout: BatchLayout,
    bytes: Vec<u8>,
    /// Final observations of each policy.
    pub finals: Vec<FinalRows>,
}

impl BatchFrame {
    /// Makes a frame of zeros.
    #[must_use]
    pub fn new(layout: BatchLayout) -> Self {
        Self {
            bytes: vec![0; layout.fixed_bytes],
            finals: layout.policies.iter().map(FinalRows::new).collect(),
            layout,
        }
    }

    /// Returns where everything lies.
    #[must_use]
    pub fn layout(&self) -> &BatchLayout {
        &self.layout
    }

    /// Returns the arrays, at the offsets of the layout.
    #[inline]
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns the arrays to be written, at the offsets of the layout.
    #[inline]
    #[must_use]
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.bytes
    }

    /// Returns layout and arrays, to write what the layout says.
    #[inline]
    #[must_use]
    pub fn parts_mut(&mut self) -> (&BatchLayout, &mut [u8], &mut [FinalRows]) {
        (&self.layout, &mut self.bytes, &mut self.finals)
    }

    /// Appends the row that a slot has now to the final observations.
    pub fn keep_final(&mut self, policy: usize, slot: usize) {
        let finals = &mut self.finals[policy];
        finals.slots.push(slot as u32);
        for (kept, entry) in finals
            .entries
            .iter_mut()
            .zip(&self.layout.policies[policy].entries)
        {
            kept.extend_from_slice(&self.bytes[entry.row(slot)]);
        }
    }

    /// Returns the whole frame; call [`BatchFrame::shorten`] when it was sent.
    ///
    /// # Errors
    /// The frame is longer than the protocol allows.
    pub fn encode(&mut self, head: BatchHead) -> Result<&[u8], WireError> {
        self.bytes[HEADER_BYTES..HEADER_BYTES + HEAD_BYTES].copy_from_slice(&head.encode());
        for finals in &self.finals {
            finals.append_to(&mut self.bytes);
        }
        let header = encode_header(FrameType::Batch, self.bytes.len() - HEADER_BYTES)?;
        self.bytes[..HEADER_BYTES].copy_from_slice(&header);
        Ok(&self.bytes)
    }

    /// Cuts off what [`BatchFrame::encode`] appended.
    pub fn shorten(&mut self) {
        self.bytes.truncate(self.layout.fixed_bytes);
    }

    /// Takes in a payload: the counterpart of [`BatchFrame::encode`].
    ///
    /// # Errors
    /// The payload has another size than the spec says, or bad slots.
    pub fn decode(&mut self, payload: &[u8]) -> Result<BatchHead, WireError> {
        let fixed = self.layout.fixed_bytes - HEADER_BYTES;
        let size = WireError::Size {
            what: "BATCH",
            bytes: payload.len(),
            expected: fixed,
        };
        let (arrays, mut rest) = payload.split_at_checked(fixed).ok_or(size.clone())?;
        let head = *arrays.first_chunk().ok_or(size)?;
        self.bytes[HEADER_BYTES + HEAD_BYTES..].copy_from_slice(&arrays[HEAD_BYTES..]);
        for (policy, finals) in self.layout.policies.iter().zip(&mut self.finals) {
            rest = read_final(policy, finals, rest)?;
        }
        if !rest.is_empty() {
            let what = format!("{} bytes too many", rest.len());
            return Err(WireError::malformed("BATCH", what));
        }
        Ok(BatchHead::decode(head))
    }
}

fn read_final<'a>(
    policy: &PolicyArrays,
    finals: &mut FinalRows,
    payload: &'a [u8],
) -> Result<&'a [u8], WireError> {
    let fail = |what: &str| WireError::malformed("BATCH, final observations", what);
    let &[a, b, c, d, 0, 0, 0, 0] = payload.first_chunk().ok_or(fail("too short"))? else {
        return Err(fail("reserved bytes are not zero"));
    };
    let num_final = u32::from_le_bytes([a, b, c, d]) as usize;
    if num_final > policy.num_agents {
        return Err(fail("more than there are slots"));
    }
    let (part, rest) = payload
        .split_at_checked(policy.final_bytes(num_final))
        .ok_or(fail("too short"))?;
    let (slots, mut rows) = part[FINAL_HEAD_BYTES..].split_at(padded(num_final * 4));
    let (slots, _) = slots[..num_final * 4].as_chunks::<4>();
    finals.slots = slots.iter().map(|slot| u32::from_le_bytes(*slot)).collect();
    let is_ascending = finals.slots.is_sorted_by(|a, b| a < b);
    let is_within = finals
        .slots
        .last()
        .is_none_or(|slot| (*slot as usize) < policy.num_agents);
    if !is_ascending || !is_within {
        return Err(fail("slots are out of range or not ascending"));
    }
    for (entry, array) in finals.entries.iter_mut().zip(&policy.entries) {
        let (own, after) = rows.split_at(padded(num_final * array.row_bytes));
        *entry = own[..num_final * array.row_bytes].to_vec();
        rows = after;
    }
    Ok(rest)
}
