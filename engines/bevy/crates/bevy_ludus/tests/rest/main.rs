//! Environments as they are written for bevy_rl, in real apps, asked over real sockets.
#![cfg(feature = "rest")]
#![allow(clippy::unwrap_used)]

mod client;
mod endings;
mod endpoints;
mod faults;
mod game;
mod lock_step;
mod pixels;
mod refusals;
