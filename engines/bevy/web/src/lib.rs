//! The trained cart-pole in a browser: the game of the example `cartpole`, played by its policy in
//! Rust. The page draws it, and a person may push the pole. On a desktop this crate is empty.

#[cfg(target_arch = "wasm32")]
mod browser;
#[cfg(target_arch = "wasm32")]
#[path = "../../examples/cartpole/src/game.rs"]
mod game;
#[cfg(target_arch = "wasm32")]
#[path = "../../examples/cartpole/src/motion.rs"]
mod motion;
