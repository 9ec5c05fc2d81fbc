//! Trained policies without Python: policy files (`protocol/POLICY.md`) are read, checked and run.
//!
//! Games need nothing of this: [`LudusPolicyPlugin`](crate::LudusPolicyPlugin) plays them.
//! [`PolicyModel`] is what a file holds, [`PolicyNetwork`] computes, [`ActionHead`] decides;
//! [`PolicyFrames`] keeps the last observations of a policy that looks at several.

mod activation;
mod checking;
mod dense;
mod error;
mod fields;
mod file;
mod fit;
mod frames;
mod gru;
mod head;
mod network;
#[cfg(feature = "trainer")]
mod parity;
mod policy_model;
mod vision;

pub use error::PolicyFileError;
pub use fields::Tensor;
pub use file::MAX_FILE_BYTES;
pub use frames::PolicyFrames;
pub use head::ActionHead;
pub use network::PolicyNetwork;
pub use policy_model::{
    Activation, Convolution, Distribution, ImageNetwork, Linear, Memory, MemoryKind, Normalisation,
    PolicyModel, is_image,
};

#[cfg(feature = "trainer")]
pub(crate) use parity::answer as answer_parity;
