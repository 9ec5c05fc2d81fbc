//! Policy files: from bytes to a checked model.

use super::checking::check;
use super::error::PolicyFileError;
use super::fields::Whole;
use super::policy_model::PolicyModel;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::Read;
use std::path::Path;

const FORMAT: &str = "ludus-policy";
const VERSION: u64 = 1;
/// Most bytes of a policy file.
pub const MAX_FILE_BYTES: usize = 1 << 28;

/// What every version begins with.
#[derive(Deserialize)]
struct Head {
    format: String,
    version: Whole,
}

impl PolicyModel {
    /// Reads a policy file.
    ///
    /// # Errors
    /// It cannot be read, is not a policy file of this version, or breaks a rule of POLICY.md.
    pub fn load(path: &Path) -> Result<Self, PolicyFileError> {
        let fail = |error: std::io::Error| PolicyFileError::Unreadable {
            path: path.to_owned(),
            reason: error.to_string(),
        };
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(fail)?;
        file.take(MAX_FILE_BYTES as u64 + 1)
            .read_to_end(&mut bytes)
            .map_err(fail)?;
        Self::read(&bytes)
    }

    /// Reads the bytes of a policy file.
    ///
    /// # Errors
    /// They are no policy file of this version, or break a rule of POLICY.md.
    pub fn read(bytes: &[u8]) -> Result<Self, PolicyFileError> {
        if bytes.len() > MAX_FILE_BYTES {
            let limit = MAX_FILE_BYTES;
            return Err(PolicyFileError::TooLong { limit });
        }
        let head: Head = parse(bytes)?;
        if head.format != FORMAT {
            let reason = format!("expected \"{FORMAT}\", got {:?}", head.format);
            return Err(PolicyFileError::malformed("format", reason));
        }
        if head.version != Whole(VERSION) {
            let reason = format!("expected {VERSION}, got {}", head.version.0);
            return Err(PolicyFileError::malformed("version", reason));
        }
        let model: Self = parse(bytes)?;
        check(&model)?;
        Ok(model)
    }
}

fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, PolicyFileError> {
    // Serde would take a list for a struct.
    if bytes.iter().find(|byte| !byte.is_ascii_whitespace()) != Some(&b'{') {
        return Err(PolicyFileError::NotJson("it begins with no brace".into()));
    }
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut reader).map_err(explain)?;
    let rest = reader.end();
    rest.map_err(|error| PolicyFileError::NotJson(error.to_string()))?;
    Ok(value)
}

fn explain(error: serde_path_to_error::Error<serde_json::Error>) -> PolicyFileError {
    let place = error.path().to_string();
    let inner = error.into_inner();
    if inner.is_data() {
        let place = if place == "." { "the whole" } else { &place };
        PolicyFileError::malformed(place, inner.to_string())
    } else {
        PolicyFileError::NotJson(inner.to_string())
    }
}
