//! The Ludus protocol without input or output: frames, the handshake, the spec and the payloads
//! of `RESET`, `STEP`, `BATCH`, `CALL`, `RESULT` and `ERROR` (`protocol/PROTOCOL.md`).
//!
//! Everything here reads and writes, so that both ends can be tested against the golden frames.
//! Whatever bytes come in, the only thing that comes out beside a value is a [`WireError`].

mod actions;
mod batch;
mod call;
mod error;
mod frame;
mod handshake;
mod json;
#[cfg(feature = "trainer")]
mod proof;
mod report;
mod reset;
mod spec;
mod spec_rules;
mod state;

pub use actions::{ActionFrame, ActionLayout, ActionRow, PolicyActions};
pub use batch::{ArrayLayout, BatchFrame, BatchHead, BatchLayout, FLAG_REQUESTS, FLAG_RESET};
pub use batch::{FinalRows, PolicyArrays};
pub use call::{Call, CallResult, Outcome};
pub use error::WireError;
pub use frame::{
    Frame, FrameReader, FrameType, HEADER_BYTES, decode_header, encode_frame, encode_header, padded,
};
pub use handshake::{
    CAPABILITIES, Challenge, EngineConfig, EngineName, Hello, MAX_SPIN_US, PROTOCOL_MAX,
    PROTOCOL_MIN, Proof, Versions, Welcome, WorldLayout,
};
pub use json::{decode_json, encode_json, read_object};
#[cfg(feature = "trainer")]
pub use proof::{NONCE_BYTES, Nonce, Role, from_hex, is_proof, make_proof, to_hex};
pub use report::{ErrorCode, ErrorReport};
pub use reset::{ResetAction, ResetRequest};
pub use spec::{
    ActionComponent, ActionKind, AgentSpec, Bound, DType, EpisodeMode, ObservationEntry,
    PolicySpec, Spec,
};
pub use spec_rules::{
    MAX_AGENTS, MAX_DIMENSIONS, MAX_ENTRIES, MAX_NAME_LENGTH, MAX_POLICIES, MAX_WORLDS,
};
pub use state::{ConnectionState, State};
