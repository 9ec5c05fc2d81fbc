//! `RESET` payloads (PROTOCOL.md §5).

use super::{FrameType, MAX_WORLDS, WireError, encode_frame, padded};
use serde_json::Value;

const HEAD_BYTES: usize = 8;

/// What happens to a world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ResetAction {
    /// Nothing.
    Leave = 0,
    /// It begins a new episode and goes on with its random stream.
    NextEpisode = 1,
    /// It begins a new episode with a seed.
    Seed = 2,
}

/// Which worlds begin a new episode, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct ResetRequest {
    /// Seed of each world, used where the action is [`ResetAction::Seed`].
    pub seeds: Vec<u64>,
    /// What happens to each world.
    pub actions: Vec<ResetAction>,
    /// Null, an object for every world that is reset, or a list with one object or null per world.
    pub parameters: Value,
}

impl ResetRequest {
    /// Reads a payload.
    ///
    /// # Errors
    /// It is malformed.
    pub fn decode(payload: &[u8]) -> Result<Self, WireError> {
        let (num_worlds, text_bytes) = Self::head(payload)?;
        let start = HEAD_BYTES + padded(num_worlds * 9);
        let expected = start + text_bytes;
        if payload.len() != expected {
            return Err(WireError::Size {
                what: "RESET",
                bytes: payload.len(),
                expected,
            });
        }
        let (seeds, rest) = payload[HEAD_BYTES..start].split_at(num_worlds * 8);
        let (seeds, _) = seeds.as_chunks::<8>();
        let actions = rest[..num_worlds].iter().map(|number| read_action(*number));
        let request = Self {
            seeds: seeds.iter().map(|seed| u64::from_le_bytes(*seed)).collect(),
            actions: actions.collect::<Result<_, _>>()?,
            parameters: serde_json::from_slice(&payload[start..])
                .map_err(|error| WireError::malformed("RESET.parameters", error.to_string()))?,
        };
        request.check_parameters()?;
        Ok(request)
    }

    /// Returns the whole frame.
    ///
    /// # Errors
    /// The frame is too long.
    pub fn encode(&self) -> Result<Vec<u8>, WireError> {
        let text = self.parameters.to_string();
        let num_worlds = self.seeds.len();
        let mut payload = Vec::with_capacity(HEAD_BYTES + padded(num_worlds * 9) + text.len());
        payload.extend_from_slice(&(num_worlds as u32).to_le_bytes());
        payload.extend_from_slice(&(text.len() as u32).to_le_bytes());
        payload.extend(self.seeds.iter().flat_map(|seed| seed.to_le_bytes()));
        payload.extend(self.actions.iter().map(|action| *action as u8));
        payload.resize(padded(payload.len()), 0);
        payload.extend_from_slice(text.as_bytes());
        encode_frame(FrameType::Reset, &payload)
    }

    /// Returns whether every world gets a seed.
    #[must_use]
    pub fn is_seeding_all(&self) -> bool {
        self.actions
            .iter()
            .all(|action| *action == ResetAction::Seed)
    }

    /// Returns the parameters that a world gets: null where it keeps those it has.
    #[must_use]
    pub fn parameters_of(&self, world: usize) -> &Value {
        match &self.parameters {
            Value::Array(items) => items.get(world).unwrap_or(&Value::Null),
            value => value,
        }
    }

    fn head(payload: &[u8]) -> Result<(usize, usize), WireError> {
        let size = WireError::Size {
            what: "RESET",
            bytes: payload.len(),
            expected: HEAD_BYTES,
        };
        let &[a, b, c, d, e, f, g, h] = payload.first_chunk().ok_or(size)?;
        let num_worlds = u32::from_le_bytes([a, b, c, d]);
        if !(1..=MAX_WORLDS).contains(&u64::from(num_worlds)) {
            let what = format!("expected 1 to {MAX_WORLDS}, got {num_worlds}");
            return Err(WireError::malformed("RESET.num_worlds", what));
        }
        Ok((
            num_worlds as usize,
            u32::from_le_bytes([e, f, g, h]) as usize,
        ))
    }

    fn check_parameters(&self) -> Result<(), WireError> {
        let is_fit = |value: &Value| value.is_null() || value.is_object();
        let is_ok = match &self.parameters {
            Value::Array(items) => items.len() == self.seeds.len() && items.iter().all(is_fit),
            value => is_fit(value),
        };
        if is_ok {
            return Ok(());
        }
        let what = "expected null, an object, or a list of one object or null per world";
        Err(WireError::malformed("RESET.parameters", what))
    }
}

fn read_action(number: u8) -> Result<ResetAction, WireError> {
    match number {
        0 => Ok(ResetAction::Leave),
        1 => Ok(ResetAction::NextEpisode),
        2 => Ok(ResetAction::Seed),
        _ => Err(WireError::malformed(
            "RESET.action",
            format!("expected 0 to 2, got {number}"),
        )),
    }
}
