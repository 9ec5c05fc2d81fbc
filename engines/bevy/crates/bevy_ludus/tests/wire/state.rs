//! Every frame in every state of the conversation.

use bevy_ludus::wire::{ConnectionState, FrameType, State, WireError};
use std::collections::HashMap;

/// What brings a fresh conversation into each state: frames, and whether the engine sends them.
fn ways() -> Vec<(State, Vec<(bool, FrameType)>)> {
    let ready = vec![
        (true, FrameType::Hello),
        (false, FrameType::Challenge),
        (true, FrameType::Proof),
        (false, FrameType::Welcome),
        (true, FrameType::Spec),
    ];
    let after = |frames: &[(bool, FrameType)]| [ready.as_slice(), frames].concat();
    vec![
        (State::Connected, vec![]),
        (State::Greeted, ready[..1].to_vec()),
        (State::Challenged, ready[..2].to_vec()),
        (State::Proven, ready[..3].to_vec()),
        (State::Configured, ready[..4].to_vec()),
        (State::Ready, ready.clone()),
        (State::Stepping, after(&[(false, FrameType::Reset)])),
        (State::Calling, after(&[(false, FrameType::Call)])),
        (State::Pinging, after(&[(false, FrameType::Ping)])),
        (State::Closed, after(&[(false, FrameType::Close)])),
    ]
}

fn follow(state: &mut ConnectionState, is_sent: bool, frame: FrameType) -> Result<(), WireError> {
    if is_sent {
        state.send(frame)
    } else {
        state.receive(frame)
    }
}

fn conversation(frames: &[(bool, FrameType)]) -> ConnectionState {
    let mut state = ConnectionState::default();
    for (is_sent, frame) in frames {
        follow(&mut state, *is_sent, *frame).expect("a way");
    }
    state
}

/// The table of PROTOCOL.md §2, without `ERROR` and `CLOSE`.
fn table() -> HashMap<(State, bool, FrameType), State> {
    HashMap::from([
        ((State::Connected, true, FrameType::Hello), State::Greeted),
        (
            (State::Greeted, false, FrameType::Challenge),
            State::Challenged,
        ),
        ((State::Challenged, true, FrameType::Proof), State::Proven),
        (
            (State::Proven, false, FrameType::Welcome),
            State::Configured,
        ),
        ((State::Configured, true, FrameType::Spec), State::Ready),
        ((State::Ready, false, FrameType::Reset), State::Stepping),
        ((State::Ready, false, FrameType::Call), State::Calling),
        ((State::Ready, false, FrameType::Ping), State::Pinging),
        ((State::Stepping, true, FrameType::Batch), State::Ready),
        ((State::Calling, true, FrameType::Result), State::Ready),
        ((State::Pinging, true, FrameType::Pong), State::Ready),
    ])
}

#[test]
fn every_frame_in_every_state() {
    let table = table();
    for (state, way) in ways() {
        for is_sent in [true, false] {
            for frame in FrameType::ALL {
                let mut conversation = conversation(&way);
                assert_eq!(conversation.state(), state);
                let is_ending = matches!(frame, FrameType::Error | FrameType::Close);
                let expected = match (is_ending, state) {
                    (true, State::Closed) => None,
                    (true, _) => Some(State::Closed),
                    _ => table.get(&(state, is_sent, frame)).copied(),
                };
                let result = follow(&mut conversation, is_sent, frame);
                assert_eq!(result.is_ok(), expected.is_some(), "{frame} in {state}");
                assert_eq!(
                    conversation.state(),
                    expected.unwrap_or(state),
                    "{frame} in {state}"
                );
            }
        }
    }
}

#[test]
fn a_step_needs_a_reset_first() {
    let (_, way) = ways().swap_remove(5);
    let mut state = conversation(&way);
    assert_eq!(
        state.receive(FrameType::Step),
        Err(WireError::StepBeforeReset)
    );
    state.receive(FrameType::Reset).unwrap();
    state.send(FrameType::Batch).unwrap();
    state.receive(FrameType::Step).unwrap();
    state.send(FrameType::Batch).unwrap();
    state.require_reset();
    assert_eq!(
        state.receive(FrameType::Step),
        Err(WireError::StepBeforeReset)
    );
}
