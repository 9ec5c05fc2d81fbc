//! The motion of a cart on a track and of a pole that is hinged on it.

use bevy_ecs::component::Component;

/// Push on the cart, newtons.
const FORCE: f32 = 120.0;
const CART_MASS: f32 = 1.0;
const POLE_MASS: f32 = 1.0;
/// From the hinge to the centre of the pole, metres.
const POLE_CENTRE: f32 = 7.0;
/// Of the pole, a box of 9.3 m by 1 m, around its centre, kg m².
const POLE_INERTIA: f32 = POLE_MASS * (9.3 * 9.3 + 1.0) / 12.0;

/// A cart and its pole.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Cart {
    /// Of the cart, metres from the middle.
    pub position: f32,
    /// Of the cart, m/s.
    pub velocity: f32,
    /// Of the pole from upright, radians; positive towards +z.
    pub angle: f32,
    /// Of the pole, rad/s.
    pub angular_velocity: f32,
    /// What pulls the pole down, m/s².
    pub gravity: f32,
}

impl Cart {
    /// Lets time pass: first the velocities change, then the places (as in physics engines).
    ///
    /// With the lean φ and the place z the equations of motion are
    /// (M + m) z″ + m l cos φ φ″ = F + m l sin φ φ′² and m l cos φ z″ + (I + m l²) φ″ = m g l sin φ.
    pub fn advance(&mut self, direction: f32, seconds: f32) {
        let (sine, cosine) = self.angle.sin_cos();
        let coupling = POLE_MASS * POLE_CENTRE * cosine;
        let mass = CART_MASS + POLE_MASS;
        let inertia = POLE_INERTIA + POLE_MASS * POLE_CENTRE * POLE_CENTRE;
        let centrifugal =
            POLE_MASS * POLE_CENTRE * sine * self.angular_velocity * self.angular_velocity;
        let push = direction * FORCE + centrifugal;
        let pull = POLE_MASS * self.gravity * POLE_CENTRE * sine;
        let determinant = mass * inertia - coupling * coupling;
        self.velocity += (inertia * push - coupling * pull) / determinant * seconds;
        self.angular_velocity += (mass * pull - coupling * push) / determinant * seconds;
        self.position += self.velocity * seconds;
        self.angle += self.angular_velocity * seconds;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: f32 = 1.0 / 60.0;

    /// What the Godot example does from the seed 7, measured with Godot 4.6.3: direction, then place
    /// (m), velocity (m/s), angle (rad) and angular velocity (rad/s) after a step of two ticks.
    const GODOT: [(f32, [f32; 4]); 8] = [
        (-1.0, [-0.201, -3.54, -0.005, 0.44]),
        (-1.0, [-0.408, -7.081, 0.021, 0.88]),
        (-1.0, [-0.732, -10.616, 0.061, 1.32]),
        (-1.0, [-1.174, -14.118, 0.116, 1.755]),
        (-1.0, [-1.73, -17.532, 0.185, 2.176]),
        (1.0, [-2.223, -13.929, 0.246, 1.735]),
        (1.0, [-2.599, -10.459, 0.294, 1.323]),
        (-1.0, [-3.029, -13.701, 0.348, 1.715]),
    ];

    #[test]
    fn the_motion_is_that_of_the_godot_example() {
        let mut cart = Cart {
            position: -0.112_949,
            angle: -0.015_818,
            gravity: 3.7,
            ..Cart::default()
        };
        for (direction, expected) in GODOT {
            cart.advance(direction, TICK);
            cart.advance(direction, TICK);
            let found = [
                cart.position,
                cart.velocity,
                cart.angle,
                cart.angular_velocity,
            ];
            for (found, expected) in found.iter().zip(expected) {
                let error = (found - expected).abs();
                assert!(
                    error < 0.005 + 0.01 * expected.abs(),
                    "{found} is not {expected}"
                );
            }
        }
    }

    #[test]
    fn a_pole_that_leans_falls_and_an_upright_one_stands() {
        let mut cart = Cart {
            angle: 0.01,
            gravity: 3.7,
            ..Cart::default()
        };
        for _ in 0..120 {
            cart.advance(0.0, TICK);
        }
        assert!(cart.angle > 0.02, "{}", cart.angle);
        let upright = Cart {
            gravity: 3.7,
            ..Cart::default()
        };
        let mut still = upright;
        still.advance(0.0, TICK);
        assert_eq!(still, upright);
    }
}
