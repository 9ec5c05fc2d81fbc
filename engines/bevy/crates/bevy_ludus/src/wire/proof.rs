//! Proofs that a side knows the token, without telling it (PROTOCOL.md §3).

use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

/// Length of a nonce and of a proof, bytes.
pub const NONCE_BYTES: usize = 32;

/// Random bytes that no other greeting has, or a proof about them.
pub type Nonce = [u8; NONCE_BYTES];

/// The side whose proof it is: a part of it, so that nobody can send a proof back to its maker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The game.
    Engine,
    /// The trainer.
    Trainer,
}

fn mac(token: &str, role: Role, engine: &Nonce, trainer: &Nonce) -> Hmac<Sha256> {
    let mut mac = Hmac::<Sha256>::new_from_slice(token.as_bytes()).expect("a key of any length");
    mac.update(match role {
        Role::Engine => b"ludus 2 engine",
        Role::Trainer => b"ludus 2 trainer",
    });
    mac.update(engine);
    mac.update(trainer);
    mac
}

/// Returns the proof of a side that it knows a token, for the nonces of both sides.
#[must_use]
pub fn make_proof(token: &str, role: Role, engine: &Nonce, trainer: &Nonce) -> Nonce {
    mac(token, role, engine, trainer)
        .finalize()
        .into_bytes()
        .into()
}

/// Returns whether a proof is right, in a time that tells nothing about the difference.
#[must_use]
pub fn is_proof(proof: &Nonce, token: &str, role: Role, engine: &Nonce, trainer: &Nonce) -> bool {
    mac(token, role, engine, trainer)
        .verify_slice(proof)
        .is_ok()
}

/// Returns the hexadecimal digits of a nonce or proof.
#[must_use]
pub fn to_hex(bytes: &Nonce) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reads a nonce or proof; none unless it is 64 hexadecimal digits.
#[must_use]
pub fn from_hex(text: &str) -> Option<Nonce> {
    let (pairs, rest) = text.as_bytes().as_chunks::<2>();
    if !rest.is_empty() {
        return None;
    }
    let digit = |digit: u8| char::from(digit).to_digit(16);
    let byte = |[high, low]: &[u8; 2]| u8::try_from(digit(*high)? << 4 | digit(*low)?).ok();
    let bytes: Option<Vec<u8>> = pairs.iter().map(byte).collect();
    bytes?.try_into().ok()
}
