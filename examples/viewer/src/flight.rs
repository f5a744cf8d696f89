//! A camera that flies.

use deep_screen_space::{
    Camera, Error, Viewport,
    glam::{DVec2, DVec3},
};
use support::raster;

/// Where the eye is and where it looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    pub eye: DVec3,
    /// Radians about y from −z, to the left.
    pub yaw: f64,
    /// Radians above the horizon.
    pub pitch: f64,
    pub vertical_fov_degrees: f64,
    /// Distance of the near plane.
    pub near: f64,
}

/// As far up and down as one can look: the camera's up is y.
const STEEPEST: f64 = 1.55;

impl Pose {
    pub fn new(eye: DVec3, target: DVec3, vertical_fov_degrees: f64, near: f64) -> Self {
        let ahead = (target - eye).normalize_or(DVec3::NEG_Z);
        Self {
            eye,
            yaw: f64::atan2(-ahead.x, -ahead.z),
            pitch: ahead.y.asin().clamp(-STEEPEST, STEEPEST),
            vertical_fov_degrees,
            near,
        }
    }

    pub fn ahead(&self) -> DVec3 {
        let (sin, cos) = self.yaw.sin_cos();
        let (up, level) = self.pitch.sin_cos();
        DVec3::new(-sin * level, up, -cos * level)
    }

    /// The camera for a picture of that size.
    ///
    /// # Errors
    /// [`Error::Camera`] where the eye is too far away for its numbers.
    pub fn camera(&self, [width, height]: [u32; 2]) -> Result<Camera, Error> {
        let aspect = f64::from(width) / f64::from(height);
        let projection = raster::perspective(self.vertical_fov_degrees, aspect, self.near);
        let viewport = Viewport::full(width, height);
        Camera::look_at(
            self.eye,
            self.eye + self.ahead(),
            DVec3::Y,
            projection,
            viewport,
        )
    }
}

/// The directions that keys are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    Ahead,
    Back,
    Left,
    Right,
    Up,
    Down,
}

impl Way {
    pub const ALL: [Self; 6] = [
        Self::Ahead,
        Self::Back,
        Self::Left,
        Self::Right,
        Self::Up,
        Self::Down,
    ];

    pub fn key(self) -> &'static str {
        match self {
            Self::Ahead => "w",
            Self::Back => "s",
            Self::Left => "a",
            Self::Right => "d",
            Self::Up => "e",
            Self::Down => "q",
        }
    }
}

/// The pose, and what moves it.
#[derive(Clone, Copy, Debug)]
pub struct Flight {
    pub pose: Pose,
    /// World units in a second.
    pub speed: f64,
    pub fast: bool,
    held: [bool; 6],
}

impl Flight {
    pub fn new(pose: Pose, speed: f64) -> Self {
        Self {
            pose,
            speed,
            fast: false,
            held: [false; 6],
        }
    }

    /// A key goes down or up.
    pub fn hold(&mut self, way: Way, held: bool) {
        self.held[way as usize] = held;
    }

    /// No key is held, as where the window loses the keyboard.
    pub fn release(&mut self) {
        self.held = [false; 6];
        self.fast = false;
    }

    pub fn is_moving(&self) -> bool {
        self.held.contains(&true)
    }

    /// A mouse dragged by so many pixels.
    pub fn turn(&mut self, by: DVec2) {
        const RADIANS_A_PIXEL: f64 = 0.004;
        self.pose.yaw = (self.pose.yaw - RADIANS_A_PIXEL * by.x) % std::f64::consts::TAU;
        let pitch = self.pose.pitch - RADIANS_A_PIXEL * by.y;
        self.pose.pitch = pitch.clamp(-STEEPEST, STEEPEST);
    }

    /// A wheel turned by so many notches.
    pub fn hasten(&mut self, notches: f64) {
        self.speed = (self.speed * 1.2_f64.powf(notches)).clamp(1e-6, 1e9);
    }

    /// Time passes; a slow frame is no leap.
    pub fn advance(&mut self, seconds: f64) {
        let held = |way: Way| f64::from(u8::from(self.held[way as usize]));
        let ahead = self.pose.ahead();
        let right = ahead.cross(DVec3::Y).normalize_or(DVec3::X);
        let way = ahead * (held(Way::Ahead) - held(Way::Back))
            + right * (held(Way::Right) - held(Way::Left))
            + DVec3::Y * (held(Way::Up) - held(Way::Down));
        let speed = self.speed * if self.fast { 4.0 } else { 1.0 };
        self.pose.eye += way.normalize_or_zero() * speed * seconds.clamp(0.0, 0.2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_where_it_was_told_to() {
        let eye = DVec3::new(1.0, 2.0, 3.0);
        for target in [
            DVec3::new(4.0, 2.5, -3.0),
            DVec3::new(-4.0, 0.0, 9.0),
            DVec3::new(1.0, 2.0, 0.0),
        ] {
            let pose = Pose::new(eye, target, 45.0, 0.1);
            let off = pose.ahead().distance((target - eye).normalize());
            assert!(off < 1e-12, "{off} off {target}");
        }
        assert!(Pose::new(eye, eye, 45.0, 0.1).camera([4, 3]).is_ok());
        let down = Pose::new(eye, eye - DVec3::Y, 45.0, 0.1);
        assert!(down.camera([4, 3]).is_ok());
    }

    #[test]
    fn flies_by_keys_and_turns_to_the_mouse() {
        let mut flight = Flight::new(Pose::new(DVec3::ZERO, DVec3::NEG_Z, 45.0, 0.1), 2.0);
        flight.advance(0.1);
        assert_eq!(flight.pose.eye, DVec3::ZERO);
        flight.hold(Way::Ahead, true);
        flight.advance(0.1);
        assert!(flight.pose.eye.distance(DVec3::new(0.0, 0.0, -0.2)) < 1e-12);
        // To the right is where x is.
        flight.release();
        flight.hold(Way::Right, true);
        flight.advance(0.1);
        assert!(flight.pose.eye.x > 0.19);
        flight.turn(DVec2::new(100.0, 0.0));
        assert!(flight.pose.ahead().x > 0.3);
        flight.turn(DVec2::new(0.0, -1e9));
        assert!(flight.pose.camera([1, 1]).is_ok());
    }
}
