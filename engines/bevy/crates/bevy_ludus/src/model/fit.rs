//! Whether a policy fits the agents of a game (POLICY.md §5).

use super::error::PolicyFileError;
use super::policy_model::PolicyModel;
use crate::wire::{ActionComponent, ActionKind, Bound, DType, ObservationEntry, PolicySpec};

/// How far bounds may be apart, relative to their size.
const TOLERANCE: f64 = 1e-5;

impl PolicyModel {
    /// Checks that agents have what the policy looks at and decide what it decides. Returns for
    /// every entry of the policy the index of theirs.
    ///
    /// # Errors
    /// An entry is missing or of another type or shape, or a component differs; the error names it.
    pub fn fit(&self, agents: &PolicySpec) -> Result<Vec<usize>, PolicyFileError> {
        let entries = self.observation.iter().map(|entry| find(entry, agents));
        let entries = entries.collect::<Result<_, _>>()?;
        let (own, theirs) = (self.action.len(), agents.action.len());
        if own != theirs {
            let text = format!("the policy decides {own} components, the agent has {theirs}");
            return Err(incompatible("action", text));
        }
        for (own, theirs) in self.action.iter().zip(&agents.action) {
            compare(own, theirs)?;
        }
        if self.has_action_mask && !agents.has_action_mask {
            let text = "the policy was trained with one, the agent has none";
            return Err(incompatible("has_action_mask", text));
        }
        Ok(entries)
    }
}

fn find(entry: &ObservationEntry, agents: &PolicySpec) -> Result<usize, PolicyFileError> {
    let place = format!("observation[{:?}]", entry.name);
    let named = |theirs: &ObservationEntry| theirs.name == entry.name;
    let Some(index) = agents.observation.iter().position(named) else {
        let text = "the policy needs this entry, the agent has none";
        return Err(incompatible(place, text));
    };
    let theirs = &agents.observation[index];
    if theirs.dtype == entry.dtype && theirs.shape == entry.shape {
        return Ok(index);
    }
    let kind = |entry: &ObservationEntry| format!("{} {:?}", name_of(entry.dtype), entry.shape);
    let (own, theirs) = (kind(entry), kind(theirs));
    let text = format!("the policy was trained on {own}, the agent has {theirs}");
    Err(incompatible(place, text))
}

fn compare(own: &ActionComponent, theirs: &ActionComponent) -> Result<(), PolicyFileError> {
    let refuse = |text: String| Err(incompatible(format!("action[{:?}]", own.name), text));
    if own.name != theirs.name {
        let name = &theirs.name;
        let text = "the policy decides this component, the agent has";
        return refuse(format!("{text} {name:?} in its place"));
    }
    match (&own.kind, &theirs.kind) {
        (ActionKind::Discrete { n }, ActionKind::Discrete { n: other }) if n != other => refuse(
            format!("the policy chooses among {n}, the agent has {other}"),
        ),
        (ActionKind::Discrete { .. }, ActionKind::Discrete { .. }) => Ok(()),
        (
            ActionKind::Continuous { size, low, high },
            ActionKind::Continuous {
                size: other_size,
                low: other_low,
                high: other_high,
            },
        ) => {
            if size != other_size {
                let text = format!("the policy decides {size} numbers, the agent has {other_size}");
                return refuse(text);
            }
            let is_alike = (0..*size as usize).all(|element| {
                are_near(low, other_low, element) && are_near(high, other_high, element)
            });
            if is_alike {
                return Ok(());
            }
            let range = |low: &Bound, high: &Bound| format!("{} to {}", show(low), show(high));
            let (own, theirs) = (range(low, high), range(other_low, other_high));
            refuse(format!(
                "the policy was trained for {own}, the agent has {theirs}"
            ))
        }
        _ => refuse("the policy or the agent chooses, the other decides numbers".to_owned()),
    }
}

fn are_near(one: &Bound, other: &Bound, element: usize) -> bool {
    match (one.of(element), other.of(element)) {
        (Some(one), Some(other)) => (one - other).abs() <= TOLERANCE * one.abs().max(1.0),
        _ => false,
    }
}

fn show(bound: &Bound) -> String {
    match bound {
        Bound::All(value) => value.to_string(),
        Bound::Each(values) => format!("{values:?}"),
    }
}

fn name_of(dtype: DType) -> &'static str {
    match dtype {
        DType::Float32 => "float32",
        DType::Uint8 => "uint8",
        DType::Int64 => "int64",
    }
}

fn incompatible(place: impl Into<String>, reason: impl Into<String>) -> PolicyFileError {
    PolicyFileError::Incompatible {
        place: place.into(),
        reason: reason.into(),
    }
}
