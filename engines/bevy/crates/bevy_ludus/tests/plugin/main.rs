//! A small game on the real plugin, driven over a real socket.

mod control;
mod game;
mod membership;
mod refusals;
mod sensors;
mod stepping;
mod trainer;
#[cfg(feature = "camera")]
mod windows;
