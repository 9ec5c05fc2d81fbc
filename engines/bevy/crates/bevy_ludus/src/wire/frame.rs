//! Frames: header, types and limits (PROTOCOL.md §1).

use super::WireError;
use std::fmt;

/// Length of a frame's header, bytes.
pub const HEADER_BYTES: usize = 8;
const MAX_BINARY_BYTES: usize = 1 << 28;
const MAX_JSON_BYTES: usize = 1 << 24;
const MAX_PING_BYTES: usize = 1 << 20;
/// Of frames that come before a proof.
const MAX_GREETING_BYTES: usize = 1 << 16;

/// What a frame carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum FrameType {
    /// The engine's greeting.
    Hello = 1,
    /// The trainer's answer to it.
    Welcome = 2,
    /// What the engine's worlds and policies are.
    Spec = 3,
    /// New episodes.
    Reset = 4,
    /// Actions.
    Step = 5,
    /// Observations and outcomes.
    Batch = 6,
    /// A method call.
    Call = 7,
    /// What a call returned.
    Result = 8,
    /// Are you there?
    Ping = 9,
    /// Yes.
    Pong = 10,
    /// What went wrong; the sender closes.
    Error = 11,
    /// Goodbye.
    Close = 12,
    /// The trainer's proof, and what the engine's is to be about.
    Challenge = 13,
    /// The engine's proof.
    Proof = 14,
}

impl FrameType {
    /// All types, in the order of their numbers.
    pub const ALL: [Self; 14] = [
        Self::Hello,
        Self::Welcome,
        Self::Spec,
        Self::Reset,
        Self::Step,
        Self::Batch,
        Self::Call,
        Self::Result,
        Self::Ping,
        Self::Pong,
        Self::Error,
        Self::Close,
        Self::Challenge,
        Self::Proof,
    ];

    /// Returns the type with a number.
    #[must_use]
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number).checked_sub(1)?).copied()
    }

    /// Returns the longest payload that the type may have, bytes.
    #[must_use]
    pub fn max_payload_bytes(self) -> usize {
        match self {
            Self::Reset | Self::Step | Self::Batch => MAX_BINARY_BYTES,
            Self::Ping | Self::Pong => MAX_PING_BYTES,
            Self::Close => 0,
            Self::Hello | Self::Challenge | Self::Proof => MAX_GREETING_BYTES,
            _ => MAX_JSON_BYTES,
        }
    }
}

impl fmt::Display for FrameType {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}", format!("{self:?}").to_uppercase())
    }
}

/// One whole frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// What it carries.
    pub kind: FrameType,
    /// Its bytes, without the header.
    pub payload: Vec<u8>,
}

/// Returns `num_bytes` rounded up to a multiple of 8.
#[must_use]
pub fn padded(num_bytes: usize) -> usize {
    (num_bytes + 7) & !7
}

/// Returns type and payload length that a header announces.
///
/// # Errors
/// The type is unknown, reserved bits are set, or the length is over the type's limit.
pub fn decode_header(header: [u8; HEADER_BYTES]) -> Result<(FrameType, usize), WireError> {
    let [a, b, c, d, number, flags, low, high] = header;
    let bytes = u32::from_le_bytes([a, b, c, d]) as usize;
    let frame = FrameType::from_number(number).ok_or(WireError::UnknownType(number))?;
    let reserved = u16::from_le_bytes([low, high]);
    if flags != 0 || reserved != 0 {
        return Err(WireError::Reserved {
            frame,
            flags,
            reserved,
        });
    }
    let limit = frame.max_payload_bytes();
    if bytes > limit {
        return Err(WireError::TooLong {
            frame,
            bytes,
            limit,
        });
    }
    Ok((frame, bytes))
}

/// Returns the header of a frame.
///
/// # Errors
/// The payload is longer than the type allows.
pub fn encode_header(frame: FrameType, bytes: usize) -> Result<[u8; HEADER_BYTES], WireError> {
    let limit = frame.max_payload_bytes();
    if bytes > limit {
        return Err(WireError::TooLong {
            frame,
            bytes,
            limit,
        });
    }
    let mut header = [0; HEADER_BYTES];
    // All limits are below 2³².
    header[..4].copy_from_slice(&(bytes as u32).to_le_bytes());
    header[4] = frame as u8;
    Ok(header)
}

/// Returns header and payload in one piece.
///
/// # Errors
/// The payload is longer than the type allows.
pub fn encode_frame(frame: FrameType, payload: &[u8]) -> Result<Vec<u8>, WireError> {
    let mut bytes = Vec::with_capacity(HEADER_BYTES + payload.len());
    bytes.extend_from_slice(&encode_header(frame, payload.len())?);
    bytes.extend_from_slice(payload);
    Ok(bytes)
}

/// Cuts a stream of bytes, fed in pieces of any size, into frames.
#[derive(Debug, Default)]
pub struct FrameReader {
    buffer: Vec<u8>,
}

impl FrameReader {
    /// Takes in bytes and returns the frames that are now whole.
    ///
    /// # Errors
    /// A header is not allowed; see [`decode_header`]. The stream cannot be read on.
    pub fn feed(&mut self, bytes: &[u8]) -> Result<Vec<Frame>, WireError> {
        self.buffer.extend_from_slice(bytes);
        let mut frames = Vec::new();
        let mut start = 0;
        while let Some(header) = self.buffer[start..].first_chunk::<HEADER_BYTES>() {
            let (kind, num_bytes) = decode_header(*header)?;
            let body = start + HEADER_BYTES;
            let Some(payload) = self.buffer.get(body..body + num_bytes) else {
                break;
            };
            frames.push(Frame {
                kind,
                payload: payload.to_vec(),
            });
            start = body + num_bytes;
        }
        self.buffer.drain(..start);
        Ok(frames)
    }

    /// Returns how many bytes of a frame that is not whole yet have come.
    #[must_use]
    pub fn num_pending_bytes(&self) -> usize {
        self.buffer.len()
    }
}
