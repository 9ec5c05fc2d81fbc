//! The actions in a request.

use super::error::Refusal;
use serde::Deserialize;

#[derive(Deserialize)]
struct AgentAction {
    action: Option<String>,
}

/// Reads one action text or none per agent, out of `[{"action": "…"}, {"action": null}, …]`.
///
/// # Errors
/// It is something else, or has another number of actions.
pub(super) fn read_actions(text: &[u8], num_agents: usize) -> Result<Vec<Option<String>>, Refusal> {
    let actions: Vec<AgentAction> = serde_json::from_slice(text).map_err(|error| {
        Refusal::bad_request(format!(
            "the payload is not a list of actions: {error}\nhint: [{{\"action\": \"…\"}}, …], one \
             entry per agent; null for no action"
        ))
    })?;
    if actions.len() != num_agents {
        let found = actions.len();
        return Err(Refusal::bad_request(format!(
            "the payload must have {num_agents} actions, one per agent; it has {found}"
        )));
    }
    Ok(actions.into_iter().map(|agent| agent.action).collect())
}

/// What the query of `/step` asks for.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct StepQuery {
    pub payload: Option<Vec<u8>>,
    /// Whether the answer is to hold the state as well.
    pub is_state_included: bool,
}

impl StepQuery {
    pub fn read(query: &str) -> Self {
        let mut read = Self::default();
        for (name, value) in form_urlencoded::parse(query.as_bytes()) {
            match name.as_ref() {
                "payload" => read.payload = Some(value.into_owned().into_bytes()),
                "include" => read.is_state_included = value == "state",
                _ => (),
            }
        }
        read
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn actions_are_texts_or_nothing() {
        let read = read_actions(br#"[{"action":"UP"},{"action":null},{}]"#, 3);
        assert_eq!(read, Ok(vec![Some("UP".into()), None, None]));
    }

    #[test]
    fn another_number_of_actions_is_refused() {
        let refusal = read_actions(br#"[{"action":"UP"}]"#, 2).unwrap_err();
        assert_eq!(refusal.status, 400);
        assert!(
            refusal.reason.contains("must have 2 actions"),
            "{}",
            refusal.reason
        );
    }

    #[test]
    fn queries_are_decoded() {
        let read = StepQuery::read("payload=%5B%7B%22action%22%3A+%22a%2Bb%22%7D%5D&include=state");
        assert_eq!(
            read.payload.as_deref(),
            Some(br#"[{"action": "a+b"}]"#.as_slice())
        );
        assert!(read.is_state_included);
        assert_eq!(StepQuery::read("what=ever"), StepQuery::default());
    }

    proptest! {
        #[test]
        fn what_was_sent_is_read(actions in prop::collection::vec(prop::option::of(".*"), 0..8)) {
            let entries: Vec<_> =
                actions.iter().map(|action| serde_json::json!({ "action": action })).collect();
            let text = serde_json::to_string(&entries).unwrap();
            let query: String = form_urlencoded::Serializer::new(String::new())
                .append_pair("payload", &text)
                .finish();
            let read = StepQuery::read(&query).payload.unwrap();
            prop_assert_eq!(read_actions(&read, actions.len()), Ok(actions));
        }

        #[test]
        fn anything_else_is_refused_and_nothing_panics(bytes in any::<Vec<u8>>(), query in ".*") {
            if let Err(refusal) = read_actions(&bytes, 1) {
                prop_assert_eq!(refusal.status, 400);
            }
            let _ = StepQuery::read(&query);
        }
    }
}
