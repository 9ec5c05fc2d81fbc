//! What an environment asks of the plugin.

use bevy_ecs::resource::Resource;
use std::time::Duration;

/// Where clients of bevy_rl look for the game.
const PORT: u16 = 7878;

/// How the game is shown to its clients, and when it waits for them.
#[derive(Clone, Debug, PartialEq, Resource)]
pub struct AIGymSettings {
    /// Of one agent's picture, pixels.
    pub width: u32,
    /// Of one agent's picture, pixels.
    pub height: u32,
    /// How many agents there are.
    pub num_agents: u32,
    /// How long the game runs before it is paused for the next request, seconds of its clock.
    ///
    /// 0 (and anything else that is not above 0) is lock-step: the game runs for one update, and
    /// waits for the next request without a timer. Its clock then advances by `step_seconds`.
    pub pause_interval: f32,
    /// Whether clients may ask for pixels. Programs for bevy_rl before 0.9.7 say the same by
    /// `no_graphics: false`.
    pub render_to_buffer: bool,
    /// Whether clients may not ask for pixels, as programs for bevy_rl before 0.9.7 say it. Pixels
    /// are shown if either setting asks for them.
    pub no_graphics: bool,
    /// Where to listen at 127.0.0.1; 0 takes any port that is free, which
    /// [`RestServer::address`](super::RestServer::address) tells.
    pub port: u16,
    /// How long a client waits for the game before it gets the status 504, seconds.
    pub timeout: f32,
    /// How far the clock goes in one update of lock-step, seconds.
    pub step_seconds: f32,
}

impl Default for AIGymSettings {
    fn default() -> Self {
        Self {
            width: 0,
            height: 0,
            num_agents: 0,
            pause_interval: 0.0,
            render_to_buffer: false,
            no_graphics: true,
            port: PORT,
            timeout: 30.0,
            step_seconds: 1.0 / 60.0,
        }
    }
}

impl AIGymSettings {
    pub(super) fn is_lock_step(&self) -> bool {
        self.pause_interval.is_nan() || self.pause_interval <= 0.0
    }

    /// Returns whether clients may ask for pixels.
    #[cfg(feature = "camera")]
    pub(super) fn shows_pixels(&self) -> bool {
        self.render_to_buffer || !self.no_graphics
    }

    pub(super) fn pause_every(&self) -> Duration {
        span(self.pause_interval)
    }

    pub(super) fn wait_for_game(&self) -> Duration {
        // Longer than a day would overflow the clocks of some systems.
        span(self.timeout).min(Duration::from_hours(24))
    }

    pub(super) fn step_time(&self) -> Duration {
        span(self.step_seconds)
    }
}

/// Returns a length of time; none for a negative one and for NaN.
fn span(seconds: f32) -> Duration {
    let longest = if seconds > 0.0 {
        Duration::MAX
    } else {
        Duration::ZERO
    };
    Duration::try_from_secs_f32(seconds).unwrap_or(longest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paused_every(pause_interval: f32) -> AIGymSettings {
        AIGymSettings {
            pause_interval,
            ..AIGymSettings::default()
        }
    }

    #[cfg(feature = "camera")]
    #[test]
    fn pixels_are_shown_if_either_setting_asks_for_them() {
        let shows = |render_to_buffer, no_graphics| {
            let settings = AIGymSettings {
                render_to_buffer,
                no_graphics,
                ..AIGymSettings::default()
            };
            settings.shows_pixels()
        };
        assert!(!AIGymSettings::default().shows_pixels());
        assert!(shows(true, true) && shows(false, false) && !shows(false, true));
    }

    #[test]
    fn every_number_is_an_interval_or_lock_step() {
        for number in [0.0, -0.0, -1.0, f32::NAN, f32::NEG_INFINITY] {
            assert!(paused_every(number).is_lock_step(), "{number}");
        }
        for number in [f32::MIN_POSITIVE, 0.01, f32::MAX, f32::INFINITY] {
            assert!(!paused_every(number).is_lock_step(), "{number}");
        }
        assert_eq!(paused_every(f32::INFINITY).pause_every(), Duration::MAX);
        assert_eq!(paused_every(f32::NAN).pause_every(), Duration::ZERO);
        assert_eq!(paused_every(0.25).pause_every(), Duration::from_millis(250));
    }
}
