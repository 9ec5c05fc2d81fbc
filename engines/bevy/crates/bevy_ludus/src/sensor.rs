//! Sensors: components of agents that measure a part of what the agents see.

use crate::components::{Episode, Observation};
use crate::schedules::ControlState;
use crate::space::ObservationSpace;
use crate::world::InWorld;
use bevy_ecs::batching::BatchingStrategy;
use bevy_ecs::prelude::*;
use bevy_ecs::system::{StaticSystemParam, SystemParam, SystemParamItem};
use bevy_state::prelude::*;

/// Agents whose sensors are worth a thread of their own.
const MIN_AGENTS_PER_THREAD: usize = 64;

/// A component of an agent that measures a part of its observation, such as distances along rays.
///
/// It asks whatever knows the world: a query of plain shapes as here, or the `SpatialQuery` of a
/// physics engine. [`add_sensor`](crate::LudusApp::add_sensor) says which part of the observation
/// its measurements are. Agents are measured in parallel, on decision steps only, and where
/// episodes begin those only that begin.
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_ecs::prelude::*;
/// # use bevy_ludus::prelude::*;
/// # #[derive(ActionSpace)] enum Run { Left, Right }
/// #[derive(ObservationSpace)]
/// struct Seen {
///     #[ludus(low = 0.0, high = 1.0)]
///     to_wall: f32,
/// }
///
/// #[derive(Component)]
/// struct Place(f32);
///
/// #[derive(Component)]
/// struct Wall(f32);
///
/// /// A ray to the right.
/// #[derive(Component)]
/// struct Ray {
///     reach: f32,
/// }
///
/// impl Sensor for Ray {
///     type Value = f32;
///     type Param = (Query<'static, 'static, &'static Place>, Query<'static, 'static, (&'static Wall, &'static InWorld)>);
///
///     fn sense(&self, agent: Entity, home: InWorld, (places, walls): &(Query<&Place>, Query<(&Wall, &InWorld)>)) -> f32 {
///         let Ok(place) = places.get(agent) else { return 1.0 };
///         let own = walls.iter().filter(|(_, other)| **other == home);
///         let distances = own.map(|(wall, _)| wall.0 - place.0).filter(|distance| *distance >= 0.0);
///         distances.fold(self.reach, f32::min) / self.reach
///     }
/// }
///
/// App::new()
///     .add_policy::<Seen, Run>(Policy::new("runner"))
///     .add_sensor::<Ray, Seen>(|seen, to_wall| seen.to_wall = to_wall);
/// ```
pub trait Sensor: Component {
    /// What it measures: often an array such as `[f32; 16]`.
    type Value;

    /// What it asks: a system parameter, of which it may only read.
    type Param: for<'w, 's> SystemParam<Item<'w, 's>: Sync> + 'static;

    /// Measures for one agent, in the world `home`.
    ///
    /// In the grid layout `param` has the entities of all worlds: it must leave out those of others.
    fn sense(
        &self,
        agent: Entity,
        home: InWorld,
        param: &SystemParamItem<'_, '_, Self::Param>,
    ) -> Self::Value;
}

/// Makes the system that runs a sensor of all agents, and puts what it measures into observations.
#[allow(clippy::type_complexity)] // Its parameters are those of a system.
pub(crate) fn run_sensor<S: Sensor, O: ObservationSpace>(
    put: fn(&mut O, S::Value),
) -> impl FnMut(
    Res<State<ControlState>>,
    Query<(Entity, &S, &InWorld, &Episode, &mut Observation<O>)>,
    StaticSystemParam<S::Param>,
) {
    move |state, mut agents, param| {
        let is_reset = *state.get() == ControlState::Reset;
        let param = &*param;
        let batches = BatchingStrategy::new().min_batch_size(MIN_AGENTS_PER_THREAD);
        agents.par_iter_mut().batching_strategy(batches).for_each(
            |(agent, sensor, home, episode, mut seen)| {
                if !is_reset || episode.is_beginning() {
                    put(&mut seen.0, sensor.sense(agent, *home, param));
                }
            },
        );
    }
}
