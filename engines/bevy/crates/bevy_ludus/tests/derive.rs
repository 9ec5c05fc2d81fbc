//! The derive macros: what they make of types. What they refuse is tested in their own crate.

use bevy_ludus::prelude::*;
use bevy_ludus::space;
use bevy_ludus::wire::{
    ActionFrame, ActionKind, ActionLayout, ArrayLayout, Bound, DType, PolicySpec, Spec,
};
use serde_json::Map;

#[derive(ObservationSpace, Debug, PartialEq)]
struct Seen {
    /// One number becomes an array of one.
    health: u8,
    #[ludus(low = [0.0, -1.0, -1.0], high = 1.0)]
    aim: [f32; 3],
    #[ludus(name = "items carried")]
    items: [[i64; 2]; 2],
    is_hurt: bool,
}

#[derive(ActionSpace, Debug, PartialEq, Clone, Copy)]
#[ludus(name = "move")]
enum Step {
    Stay,
    North,
    South,
}

#[derive(ActionSpace, Debug, PartialEq)]
struct Decision {
    #[ludus(n = 4)]
    weapon: usize,
    step: Step,
    is_jumping: bool,
    #[ludus(low = 0.0, high = [0.5, 2.0])]
    steering: [f32; 2],
    throttle: f32,
}

#[test]
fn fields_become_entries() {
    let entries = <Seen as space::ObservationSpace>::entries();
    let described: Vec<_> = entries
        .iter()
        .map(|one| (one.name.as_str(), one.dtype, one.shape.as_slice()))
        .collect();
    assert_eq!(
        described,
        [
            ("health", DType::Uint8, &[1][..]),
            ("aim", DType::Float32, &[3]),
            ("items carried", DType::Int64, &[2, 2]),
            ("is_hurt", DType::Uint8, &[1]),
        ]
    );
    assert_eq!(entries[1].low, Some(Bound::Each(vec![0.0, -1.0, -1.0])));
    assert_eq!(entries[1].high, Some(Bound::All(1.0)));
    assert_eq!(entries[0].low, None);
}

#[test]
fn values_become_rows() {
    let seen = Seen {
        health: 9,
        aim: [1.0, 0.5, -0.25],
        items: [[1, -2], [3, 4]],
        is_hurt: true,
    };
    let entries = <Seen as space::ObservationSpace>::entries();
    // Two slots, without padding between the arrays.
    let mut start = 0;
    let layouts: Vec<_> = entries
        .iter()
        .map(|entry| {
            let layout = ArrayLayout {
                start,
                row_bytes: entry.row_bytes(),
            };
            start += 2 * layout.row_bytes;
            layout
        })
        .collect();
    let mut bytes = vec![0; start];
    space::ObservationSpace::write(&seen, &mut space::RowWriter::new(&mut bytes, &layouts, 1));
    assert_eq!(bytes[layouts[0].row(1)], [9]);
    let aim: Vec<u8> = seen
        .aim
        .iter()
        .flat_map(|number| number.to_le_bytes())
        .collect();
    assert_eq!(bytes[layouts[1].row(1)], aim);
    let items: Vec<u8> = [1_i64, -2, 3, 4]
        .iter()
        .flat_map(|item| item.to_le_bytes())
        .collect();
    assert_eq!(bytes[layouts[2].row(1)], items);
    assert_eq!(bytes[layouts[3].row(1)], [1]);
    assert!(
        layouts
            .iter()
            .all(|layout| bytes[layout.row(0)].iter().all(|byte| *byte == 0))
    );
    let zero = Seen {
        health: 0,
        aim: [0.0; 3],
        items: [[0; 2]; 2],
        is_hurt: false,
    };
    assert_eq!(<Seen as space::ObservationSpace>::zero(), zero);
}

fn spec_of<A: space::ActionSpace>() -> Spec {
    let policy = PolicySpec {
        name: "hero".to_owned(),
        num_agents: 2,
        agents_per_world: 2,
        episode: EpisodeMode::Agent,
        max_episode_steps: None,
        observation: <Seen as space::ObservationSpace>::entries(),
        action: A::components(),
        has_action_mask: false,
        agents: Vec::new(),
        settings: Map::new(),
    };
    Spec {
        num_worlds: 1,
        layout: WorldLayout::Grid,
        ticks_per_step: 1,
        tick_rate: 60.0,
        scene: String::new(),
        policies: vec![policy],
    }
}

#[test]
fn fields_become_components_and_are_read() {
    let components = <Decision as space::ActionSpace>::components();
    let names: Vec<_> = components.iter().map(|one| one.name.as_str()).collect();
    assert_eq!(
        names,
        ["weapon", "step", "is_jumping", "steering", "throttle"]
    );
    assert_eq!(components[0].kind, ActionKind::Discrete { n: 4 });
    assert_eq!(components[1].kind, ActionKind::Discrete { n: 3 });
    assert_eq!(
        components[3].kind,
        ActionKind::Continuous {
            size: 2,
            low: Bound::All(0.0),
            high: Bound::Each(vec![0.5, 2.0]),
        }
    );
    let mut frame = ActionFrame::new(ActionLayout::new(&spec_of::<Decision>()));
    for (bytes, choice) in frame.discrete_mut(0).iter_mut().zip([0_i64, 0, 0, 3, 2, 1]) {
        *bytes = choice.to_le_bytes();
    }
    for (bytes, number) in frame
        .continuous_mut(0)
        .iter_mut()
        .zip([0.0_f32, 0.0, 0.0, 0.5, 2.0, -1.0])
    {
        *bytes = number.to_le_bytes();
    }
    let read = |slot| {
        <Decision as space::ActionSpace>::read(&mut space::RowReader::new(frame.row(0, slot)))
    };
    assert_eq!(
        read(1),
        Decision {
            weapon: 3,
            step: Step::South,
            is_jumping: true,
            steering: [0.5, 2.0],
            throttle: -1.0,
        }
    );
    assert_eq!(read(0).step, Step::Stay);
}

#[test]
fn an_enum_is_an_action_by_itself() {
    let components = <Step as space::ActionSpace>::components();
    assert_eq!(components.len(), 1);
    assert_eq!(
        (components[0].name.as_str(), &components[0].kind),
        ("move", &ActionKind::Discrete { n: 3 })
    );
    let mut frame = ActionFrame::new(ActionLayout::new(&spec_of::<Step>()));
    frame.discrete_mut(0)[1] = 1_i64.to_le_bytes();
    let read =
        |slot| <Step as space::ActionSpace>::read(&mut space::RowReader::new(frame.row(0, slot)));
    assert_eq!((read(0), read(1)), (Step::Stay, Step::North));
}
