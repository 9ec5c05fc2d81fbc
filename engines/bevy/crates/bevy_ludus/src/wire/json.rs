//! JSON payloads. Whole numbers may come as `60` or as `60.0`, since languages differ.

use super::{FrameType, WireError, encode_frame};
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

/// Reads the JSON object of a payload. `what` names it in errors.
///
/// # Errors
/// The bytes are no UTF-8, no JSON or no object.
pub fn decode_json(payload: &[u8], what: &str) -> Result<Map<String, Value>, WireError> {
    let fail = |reason: String| WireError::NotJson {
        what: what.to_owned(),
        reason,
    };
    let value: Value = serde_json::from_slice(payload).map_err(|error| fail(error.to_string()))?;
    match value {
        Value::Object(object) => Ok(object),
        _ => Err(fail("it is another JSON value".to_owned())),
    }
}

/// Reads a payload into one of the types of this module.
///
/// # Errors
/// The payload is not a JSON object, a key is missing, or a value is of the wrong type.
pub fn read_object<T: DeserializeOwned>(payload: &[u8], what: &str) -> Result<T, WireError> {
    let object = decode_json(payload, what)?;
    serde_json::from_value(Value::Object(object))
        .map_err(|error| WireError::malformed(what, error.to_string()))
}

/// Returns a whole frame with a JSON payload.
///
/// # Errors
/// The value cannot be JSON (a number is not finite), or it is too long.
pub fn encode_json<T: Serialize>(frame: FrameType, value: &T) -> Result<Vec<u8>, WireError> {
    let text = serde_json::to_vec(value)
        .map_err(|error| WireError::malformed(frame.to_string(), error.to_string()))?;
    encode_frame(frame, &text)
}

/// Reads a whole number of any JSON spelling.
pub(super) fn whole<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    whole_of(&Value::deserialize(deserializer)?).map_err(D::Error::custom)
}

/// Reads a whole number or null; see [`whole`].
pub(super) fn whole_or_null<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<u64>, D::Error> {
    match Value::deserialize(deserializer)? {
        Value::Null => Ok(None),
        value => whole_of(&value).map(Some).map_err(D::Error::custom),
    }
}

/// Reads a list of whole numbers; see [`whole`].
pub(super) fn whole_list<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<usize>, D::Error> {
    let values = Vec::<Value>::deserialize(deserializer)?;
    let read = |value: &Value| {
        let number = whole_of(value).map_err(D::Error::custom)?;
        usize::try_from(number).map_err(D::Error::custom)
    };
    values.iter().map(read).collect()
}

/// Largest whole number below which every one has a `f64` of its own.
const MAX_WHOLE: f64 = 9_007_199_254_740_992.0;

fn whole_of(value: &Value) -> Result<u64, String> {
    if let Some(number) = value.as_u64() {
        return Ok(number);
    }
    match value.as_f64() {
        Some(number) if number.fract() == 0.0 && (0.0..=MAX_WHOLE).contains(&number) => {
            Ok(number as u64)
        }
        _ => Err(format!("expected a whole number, got {value}")),
    }
}
