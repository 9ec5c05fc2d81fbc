//! A policy is played only by agents that see and decide what it was trained for.

use crate::files::golden_json;
use bevy_ludus::model::PolicyModel;
use bevy_ludus::wire::PolicySpec;
use serde_json::{Value, json};

/// Returns agents as the golden policy "mixed" was trained for.
fn agents() -> Value {
    let mut spec = golden_json("mixed");
    let object = spec.as_object_mut().expect("an object");
    object.retain(|key, _| ["observation", "action", "has_action_mask"].contains(&key.as_str()));
    for (key, value) in [
        ("name", json!("hero")),
        ("num_agents", json!(1)),
        ("agents_per_world", json!(1)),
        ("episode", json!("agent")),
        ("max_episode_steps", json!(null)),
        ("agents", json!([{"world": 0, "path": null}])),
        ("settings", json!({})),
    ] {
        object.insert(key.to_owned(), value);
    }
    spec
}

fn fit(agents: Value) -> Result<Vec<usize>, String> {
    let agents: PolicySpec = serde_json::from_value(agents).expect("a spec");
    let file = crate::files::golden("mixed");
    let model = PolicyModel::read(&file).expect("a valid policy");
    model.fit(&agents).map_err(|error| error.to_string())
}

#[test]
fn agents_of_the_training_fit_and_may_see_more_in_another_order() {
    assert_eq!(fit(agents()), Ok(vec![0, 1, 2]));
    let mut richer = agents();
    let entries = richer["observation"].as_array_mut().expect("entries");
    entries.reverse();
    entries.insert(1, json!({"name": "wind", "dtype": "float32", "shape": [1]}));
    assert_eq!(fit(richer), Ok(vec![3, 2, 0]));
}

#[test]
fn others_are_told_what_differs() {
    for (pointer, value, expected) in [
        (
            "/observation/0/name",
            json!("ray"),
            "observation[\"rays\"]: the policy needs this entry, the agent has none",
        ),
        (
            "/observation/0/shape",
            json!([6]),
            "observation[\"rays\"]: the policy was trained on float32 [2, 3], the agent has \
             float32 [6]",
        ),
        (
            "/observation/1/dtype",
            json!("int64"),
            "observation[\"near\"]: the policy was trained on uint8 [4], the agent has int64 [4]",
        ),
        (
            "/action",
            json!([{"name": "gait", "kind": "discrete", "n": 3}]),
            "action: the policy decides 4 components, the agent has 1",
        ),
        (
            "/action/1/name",
            json!("step"),
            "action[\"gait\"]: the policy decides this component, the agent has \"step\" in its \
             place",
        ),
        (
            "/action/1/n",
            json!(4),
            "action[\"gait\"]: the policy chooses among 3, the agent has 4",
        ),
        (
            "/action/0/size",
            json!(3),
            "action[\"aim\"]: the policy decides 2 numbers, the agent has 3",
        ),
        (
            "/action/0/high",
            json!(45.0),
            "action[\"aim\"]: the policy was trained for 0 to 90, the agent has 0 to 45",
        ),
        (
            "/action/0",
            json!({"name": "aim", "kind": "discrete", "n": 2}),
            "action[\"aim\"]: the policy or the agent chooses, the other decides numbers",
        ),
        (
            "/has_action_mask",
            json!(false),
            "has_action_mask: the policy was trained with one, the agent has none",
        ),
    ] {
        let mut other = agents();
        *other.pointer_mut(pointer).expect("a place") = value;
        assert_eq!(fit(other), Err(expected.to_owned()), "{pointer}");
    }
}
