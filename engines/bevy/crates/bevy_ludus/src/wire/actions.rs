//! `STEP` payloads as structures of arrays (PROTOCOL.md §6).

use super::{ActionKind, PolicySpec, Spec, WireError, padded};
use std::ops::Range;

const CHOICE_BYTES: usize = 8;
const NUMBER_BYTES: usize = 4;

/// Where the actions of one policy lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PolicyActions {
    /// Name of each choice and number of its alternatives.
    pub choices: Vec<(String, u64)>,
    /// Count of all numbers of an action.
    pub continuous_size: usize,
    /// Slots of the policy.
    pub num_agents: usize,
    discrete_start: usize,
    continuous_start: usize,
}

impl PolicyActions {
    fn new(policy: &PolicySpec, start: usize) -> Self {
        let choices = policy
            .action
            .iter()
            .filter_map(|component| match component.kind {
                ActionKind::Discrete { n } => Some((component.name.clone(), n)),
                ActionKind::Continuous { .. } => None,
            });
        let choices: Vec<_> = choices.collect();
        let num_agents = policy.num_agents as usize;
        Self {
            continuous_start: start + padded(num_agents * choices.len() * CHOICE_BYTES),
            choices,
            continuous_size: policy.continuous_size(),
            num_agents,
            discrete_start: start,
        }
    }

    /// Returns where the choices of all slots lie, without padding.
    #[must_use]
    pub fn discrete(&self) -> Range<usize> {
        let num_bytes = self.num_agents * self.choices.len() * CHOICE_BYTES;
        self.discrete_start..self.discrete_start + num_bytes
    }

    /// Returns where the numbers of all slots lie, without padding.
    #[must_use]
    pub fn continuous(&self) -> Range<usize> {
        let num_bytes = self.num_agents * self.continuous_size * NUMBER_BYTES;
        self.continuous_start..self.continuous_start + num_bytes
    }

    fn end(&self) -> usize {
        self.continuous_start + padded(self.continuous().len())
    }
}

/// Where everything lies in a `STEP`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionLayout {
    /// In the order of the spec.
    pub policies: Vec<PolicyActions>,
    /// Length of the payload.
    pub num_bytes: usize,
}

impl ActionLayout {
    /// Lays out the actions of a spec.
    #[must_use]
    pub fn new(spec: &Spec) -> Self {
        let mut policies = Vec::with_capacity(spec.policies.len());
        let mut num_bytes = 0;
        for policy in &spec.policies {
            let actions = PolicyActions::new(policy, num_bytes);
            num_bytes = actions.end();
            policies.push(actions);
        }
        Self {
            policies,
            num_bytes,
        }
    }
}

/// The actions of all agents, one after the other as they came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionFrame {
    layout: ActionLayout,
    payload: Vec<u8>,
}

impl ActionFrame {
    /// Makes actions that are all zero.
    #[must_use]
    pub fn new(layout: ActionLayout) -> Self {
        Self {
            payload: vec![0; layout.num_bytes],
            layout,
        }
    }

    /// Returns where everything lies.
    #[must_use]
    pub fn layout(&self) -> &ActionLayout {
        &self.layout
    }

    /// Returns the payload of a `STEP`.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        &self.payload
    }

    /// Takes in the payload of a `STEP`.
    ///
    /// # Errors
    /// It has another size than the spec says.
    pub fn decode(&mut self, payload: &[u8]) -> Result<(), WireError> {
        let (bytes, expected) = (payload.len(), self.layout.num_bytes);
        if bytes != expected {
            return Err(WireError::Size {
                what: "STEP",
                bytes,
                expected,
            });
        }
        self.payload.copy_from_slice(payload);
        Ok(())
    }

    /// Returns the action of a slot.
    #[inline]
    #[must_use]
    pub fn row(&self, policy: usize, slot: usize) -> ActionRow<'_> {
        let actions = &self.layout.policies[policy];
        let choices = row(
            actions.discrete_start,
            actions.choices.len() * CHOICE_BYTES,
            slot,
        );
        let numbers = row(
            actions.continuous_start,
            actions.continuous_size * NUMBER_BYTES,
            slot,
        );
        ActionRow {
            discrete: self.payload[choices].as_chunks().0,
            continuous: self.payload[numbers].as_chunks().0,
        }
    }

    /// Returns the bytes of all choices of a policy, to be written.
    #[must_use]
    pub fn discrete_mut(&mut self, policy: usize) -> &mut [[u8; CHOICE_BYTES]] {
        let range = self.layout.policies[policy].discrete();
        self.payload[range].as_chunks_mut().0
    }

    /// Returns the bytes of all numbers of a policy, to be written.
    #[must_use]
    pub fn continuous_mut(&mut self, policy: usize) -> &mut [[u8; NUMBER_BYTES]] {
        let range = self.layout.policies[policy].continuous();
        self.payload[range].as_chunks_mut().0
    }

    /// Returns whether all choices of slots that act are there to be chosen. Without a way out in
    /// the middle, as it is always true but for mistakes.
    fn has_only_alternatives(&self, actions: &PolicyActions, active: &[u8]) -> bool {
        let (choices, _) = self.payload[actions.discrete()].as_chunks::<CHOICE_BYTES>();
        let size = actions.choices.len().max(1);
        let mut is_bad = false;
        for (index, (_, n)) in actions.choices.iter().enumerate() {
            for (row, active) in choices.chunks_exact(size).zip(active) {
                // A negative choice is a huge one here.
                is_bad |= (u64::from_le_bytes(row[index]) >= *n) & (*active == 1);
            }
        }
        !is_bad
    }

    /// Finds a choice that a slot does not have. `active` says of each slot whether it acts.
    ///
    /// # Errors
    /// There is one; the text names policy, slot and component.
    pub fn check_choices(&self, policy: usize, name: &str, active: &[u8]) -> Result<(), WireError> {
        let actions = &self.layout.policies[policy];
        if self.has_only_alternatives(actions, active) {
            return Ok(());
        }
        for slot in (0..actions.num_agents).filter(|slot| active[*slot] == 1) {
            let row = self.row(policy, slot);
            for (index, (component, n)) in actions.choices.iter().enumerate() {
                let choice = row.choice(index);
                if !u64::try_from(choice).is_ok_and(|choice| choice < *n) {
                    let what = format!("expected 0 to {}, got {choice}", n - 1);
                    let place = format!("STEP, policy {name}, slot {slot}, action {component}");
                    return Err(WireError::malformed(place, what));
                }
            }
        }
        Ok(())
    }
}

#[inline]
fn row(start: usize, num_bytes: usize, slot: usize) -> Range<usize> {
    start + slot * num_bytes..start + (slot + 1) * num_bytes
}

/// The action of one agent.
#[derive(Clone, Copy, Debug)]
pub struct ActionRow<'a> {
    discrete: &'a [[u8; CHOICE_BYTES]],
    continuous: &'a [[u8; NUMBER_BYTES]],
}

impl ActionRow<'_> {
    /// Returns a choice; 0 if there is no such choice.
    #[inline]
    #[must_use]
    pub fn choice(&self, index: usize) -> i64 {
        self.discrete
            .get(index)
            .map_or(0, |bytes| i64::from_le_bytes(*bytes))
    }

    /// Returns a number; 0 if there is no such number.
    #[inline]
    #[must_use]
    pub fn number(&self, index: usize) -> f32 {
        self.continuous
            .get(index)
            .map_or(0.0, |bytes| f32::from_le_bytes(*bytes))
    }
}
