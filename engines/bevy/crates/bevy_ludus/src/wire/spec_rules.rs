//! The rules and limits that a spec keeps (PROTOCOL.md §1 and §4).

use super::{
    ActionComponent, ActionKind, BatchLayout, Bound, FrameType, ObservationEntry, PolicySpec, Spec,
    WireError, WorldLayout,
};
use std::collections::HashSet;

/// Most worlds of an engine.
pub const MAX_WORLDS: u64 = 65_536;
/// Most agents of a policy.
pub const MAX_AGENTS: u64 = 65_536;
/// Most policies.
pub const MAX_POLICIES: usize = 64;
/// Most entries of an observation, and components of an action.
pub const MAX_ENTRIES: usize = 64;
/// Most dimensions of an entry.
pub const MAX_DIMENSIONS: usize = 8;
/// Most characters of a name.
pub const MAX_NAME_LENGTH: usize = 128;
const MAX_TICKS: u64 = 100_000;
const MAX_CHOICES: u64 = 1 << 20;
const MAX_NUMBERS: u64 = 1 << 16;
const MAX_ELEMENTS: usize = 1 << 26;

type Checked = Result<(), WireError>;

pub(super) fn check(spec: &Spec) -> Checked {
    within("spec.num_worlds", spec.num_worlds, 1, MAX_WORLDS)?;
    within("spec.ticks_per_step", spec.ticks_per_step, 1, MAX_TICKS)?;
    within(
        "spec.policies",
        spec.policies.len() as u64,
        1,
        MAX_POLICIES as u64,
    )?;
    if spec.layout == WorldLayout::Scene {
        return refuse("spec.layout", "expected isolated or grid");
    }
    if !(spec.tick_rate > 0.0 && spec.tick_rate.is_finite()) {
        return refuse("spec.tick_rate", "expected a positive number");
    }
    for (index, policy) in spec.policies.iter().enumerate() {
        check_policy(&format!("spec.policies[{index}]"), policy, spec.num_worlds)?;
    }
    check_names(
        "spec.policies",
        spec.policies.iter().map(|policy| policy.name.as_str()),
    )?;
    check_size(spec)
}

fn check_size(spec: &Spec) -> Checked {
    let (bytes, limit) = (
        BatchLayout::new(spec).max_bytes(),
        FrameType::Batch.max_payload_bytes(),
    );
    if bytes > limit {
        return refuse(
            "spec",
            format!("a BATCH may need {bytes} bytes, the limit is {limit}"),
        );
    }
    Ok(())
}

fn check_policy(place: &str, policy: &PolicySpec, num_worlds: u64) -> Checked {
    check_slots(place, policy, num_worlds)?;
    if let Some(limit) = policy.max_episode_steps {
        within(&format!("{place}.max_episode_steps"), limit, 1, 1 << 31)?;
    }
    let parts = [
        ("observation", policy.observation.len()),
        ("action", policy.action.len()),
    ];
    for (key, count) in parts {
        within(
            &format!("{place}.{key}"),
            count as u64,
            1,
            MAX_ENTRIES as u64,
        )?;
    }
    for (index, entry) in policy.observation.iter().enumerate() {
        check_entry(&format!("{place}.observation[{index}]"), entry)?;
    }
    for (index, component) in policy.action.iter().enumerate() {
        check_component(&format!("{place}.action[{index}]"), component)?;
    }
    let entries = policy.observation.iter().map(|entry| entry.name.as_str());
    check_names(&format!("{place}.observation"), entries)?;
    let components = policy
        .action
        .iter()
        .map(|component| component.name.as_str());
    check_names(&format!("{place}.action"), components)?;
    if policy.has_action_mask && policy.choices().next().is_none() {
        return refuse(place, "has_action_mask, but there is no choice to mask");
    }
    Ok(())
}

fn check_slots(place: &str, policy: &PolicySpec, num_worlds: u64) -> Checked {
    let count = policy.agents.len() as u64;
    within(&format!("{place}.num_agents"), count, 1, MAX_AGENTS)?;
    let per_world = policy.agents_per_world;
    within(
        &format!("{place}.agents_per_world"),
        per_world,
        1,
        MAX_AGENTS,
    )?;
    if policy.num_agents != count || per_world * num_worlds != count {
        let what = format!("{count} agents are listed, {per_world} in each of {num_worlds} worlds");
        return refuse(place, what);
    }
    for (slot, agent) in (0..).zip(&policy.agents) {
        if agent.world != slot / per_world {
            let expected = slot / per_world;
            let what = format!("expected world {expected}, got {}", agent.world);
            return refuse(format!("{place}.agents[{slot}]"), what);
        }
    }
    Ok(())
}

fn check_entry(place: &str, entry: &ObservationEntry) -> Checked {
    let dimensions = entry.shape.len() as u64;
    within(
        &format!("{place}.shape"),
        dimensions,
        1,
        MAX_DIMENSIONS as u64,
    )?;
    let size = entry
        .shape
        .iter()
        .try_fold(1_usize, |size, length| size.checked_mul(*length));
    match size {
        Some(size) if (1..=MAX_ELEMENTS).contains(&size) => {
            check_bounds(place, size, entry.low.as_ref(), entry.high.as_ref())
        }
        _ => refuse(
            format!("{place}.shape"),
            format!("expected 1 to {MAX_ELEMENTS} elements"),
        ),
    }
}

fn check_component(place: &str, component: &ActionComponent) -> Checked {
    match &component.kind {
        ActionKind::Discrete { n } => within(&format!("{place}.n"), *n, 1, MAX_CHOICES),
        ActionKind::Continuous { size, low, high } => {
            within(&format!("{place}.size"), *size, 1, MAX_NUMBERS)?;
            check_bounds(place, *size as usize, Some(low), Some(high))
        }
    }
}

fn check_bounds(place: &str, size: usize, low: Option<&Bound>, high: Option<&Bound>) -> Checked {
    for (key, bound) in [("low", low), ("high", high)] {
        if let Some(Bound::Each(values)) = bound
            && values.len() != size
        {
            let what = format!("expected {size} numbers, got {}", values.len());
            return refuse(format!("{place}.{key}"), what);
        }
    }
    for element in 0..size {
        let smallest = low.map_or(Some(f64::NEG_INFINITY), |bound| bound.of(element));
        let largest = high.map_or(Some(f64::INFINITY), |bound| bound.of(element));
        if smallest > largest {
            return refuse(
                format!("{place}.low"),
                format!("{smallest:?} is above {largest:?}"),
            );
        }
        let are_equal = [low, high]
            .iter()
            .all(|bound| !matches!(bound, Some(Bound::Each(_))));
        if are_equal {
            break;
        }
    }
    Ok(())
}

fn check_names<'a>(place: &str, names: impl Iterator<Item = &'a str>) -> Checked {
    let mut known = HashSet::new();
    for name in names {
        let length = name.chars().count();
        if !(1..=MAX_NAME_LENGTH).contains(&length) {
            let what = format!("names have 1 to {MAX_NAME_LENGTH} characters, one has {length}");
            return refuse(place, what);
        }
        if !known.insert(name) {
            return refuse(place, format!("the name {name} comes twice"));
        }
    }
    Ok(())
}

fn within(place: &str, value: u64, low: u64, high: u64) -> Checked {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    refuse(place, format!("expected {low} to {high}, got {value}"))
}

fn refuse(place: impl Into<String>, what: impl Into<String>) -> Checked {
    Err(WireError::malformed(place, what))
}
