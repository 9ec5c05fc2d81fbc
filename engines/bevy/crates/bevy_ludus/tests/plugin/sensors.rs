//! Sensors measure when and for whom an observation is needed.

use crate::game::*;
use crate::trainer::Session;
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_ludus::wire::{ResetAction, ResetRequest};
use serde_json::Value;
use std::sync::atomic::{AtomicU32, Ordering};

/// Measures its agent's ticks, how many agents are in its world, and how often it was asked.
#[derive(Component, Default)]
struct Census {
    num_asked: AtomicU32,
}

impl Sensor for Census {
    type Value = [f32; 3];
    type Param = Query<'static, 'static, (Entity, &'static Counter, &'static InWorld)>;

    fn sense(
        &self,
        agent: Entity,
        home: InWorld,
        counters: &Query<(Entity, &Counter, &InWorld)>,
    ) -> [f32; 3] {
        let at_home = counters.iter().filter(|(_, _, other)| **other == home);
        let num_asked = self.num_asked.fetch_add(1, Ordering::Relaxed) + 1;
        let (_, counter, _) = counters.get(agent).expect("its counter");
        [counter.ticks, at_home.count() as f32, num_asked as f32]
    }
}

fn build(app: &mut App) {
    app.add_policy::<Seen, Choice>(Policy::new("hero"))
        .insert_resource(NumAgents(2))
        .add_observer(fill_world)
        .add_observer(|add: On<Add, Counter>, mut commands: Commands| {
            commands.entity(add.entity).insert(Census::default());
        })
        .add_systems(FixedUpdate, count)
        .add_systems(Act, act)
        .add_systems(Reset, begin)
        .add_sensor::<Census, Seen>(|seen, measured| {
            seen.observation[..3].copy_from_slice(&measured);
        })
        .add_plugins(LudusPlugin::default().ticks_per_step(3));
}

#[test]
fn sensors_measure_once_for_each_observation() {
    let mut session = Session::open(build, &worlds(2));
    session.reset(&seeds(0, 2), Value::Null);
    assert_eq!(session.seen(0), vec![vec![0.0, 2.0, 1.0, 0.0]; 4]);
    session.step(0);
    assert_eq!(session.seen(0), vec![vec![3.0, 2.0, 2.0, 0.0]; 4]);
    session.reset_with(&ResetRequest {
        seeds: vec![0, 9],
        actions: vec![ResetAction::Leave, ResetAction::NextEpisode],
        parameters: Value::Null,
    });
    let [left, begun] = [[3.0, 2.0, 2.0, 0.0], [0.0, 2.0, 3.0, 0.0]];
    assert_eq!(
        session.seen(0),
        [left, left, begun, begun],
        "only those that begin"
    );
    session.step(i64::from(END));
    assert_eq!(
        session.finals(0)[0],
        (0, vec![6.0, 2.0, 3.0, 0.0]),
        "the last of an episode"
    );
    assert_eq!(
        session.seen(0)[0],
        [0.0, 2.0, 4.0, 0.0],
        "the first of the next"
    );
    assert_eq!(session.trainer.close(), AppExit::Success);
}
