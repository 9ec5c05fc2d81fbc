//! The protocol without input or output: golden frames, damaged frames, states.

mod fuzz;
mod golden;
mod golden_frames;
mod state;
