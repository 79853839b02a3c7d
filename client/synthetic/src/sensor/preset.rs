//! The constants of each simulated sensor, with their sources. Lengths in metres, times in seconds,
//! pixels of the sensor's own depth image. Light is linear, 0 to 1.
//!
//! Sources:
//! - K12: K. Khoshelham and S. Oude Elberink, "Accuracy and Resolution of Kinect Depth Data for
//!   Indoor Mapping Applications", Sensors 12(2), 2012.
//! - N12: C. V. Nguyen, S. Izadi and D. Lovell, "Modeling Kinect Sensor Noise for Improved 3D
//!   Reconstruction and Tracking", 3DIMPVT 2012.
//! - D4: Intel, "RealSense D400 Series" data sheet, and A. Grunnet-Jepsen et al., "Best-Known
//!   Methods for Tuning Intel RealSense D400 Depth Cameras".
//! - AK: Microsoft, "Azure Kinect DK hardware specifications", mode NFOV unbinned.
//! - T21: M. Tölgyessy et al., "Evaluation of the Azure Kinect and Its Comparison to Kinect V1 and
//!   Kinect V2", Sensors 21(2), 2021.
//! - ARK: Apple, "ARKit: ARFrame.sceneDepth", and the announcement of the iPad Pro of 2020.
//!
//! *Chosen* marks a value without a source: a plausible one for a lit room.

/// One sensor. An effect is off where its constant is 0 or absent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Columns of the depth image that the constants in pixels are for.
    pub native_columns: u32,
    /// Nearest depth.
    pub near: f32,
    /// Farthest depth.
    pub far: f32,
    /// Noise along the ray.
    pub axial: Axial,
    /// Standard deviation of the place where a depth pixel looks, pixels; seen at edges only, since
    /// on a surface it is part of the axial figure.
    pub lateral: f32,
    /// Distance over which that place is the same for neighbours, pixels: blobs at edges.
    pub lateral_reach: f32,
    /// Step of 1/z between two values of the sensor, 1/m.
    pub inverse_step: f32,
    /// Columns and rows of the coarse grid that depth is measured on, then interpolated.
    pub grid: Option<[usize; 2]>,
    /// Share of the pixels at an edge with a depth between both surfaces: flying pixels.
    pub flying: f32,
    /// Distance of the two eyes (or of projector and eye): places that only one sees are holes.
    pub baseline: f32,
    /// Holes where the cosine between ray and surface normal is less.
    pub least_cosine: f32,
    /// Holes where brightness x cosine / z² is less, 1/m².
    pub least_signal: f32,
    /// Time from the color exposure to the depth exposure.
    pub depth_lag: f64,
    /// The color camera.
    pub color: ColorPreset,
}

/// Standard deviation of depth: floor + linear z + quadratic (z - offset)² + angle θ² / (√z (π/2 -
/// θ)²), metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axial {
    /// Constant part.
    pub floor: f32,
    /// Per metre.
    pub linear: f32,
    /// Per square metre.
    pub quadratic: f32,
    /// Distance with the least noise.
    pub offset: f32,
    /// Growth with the angle of incidence.
    pub angle: f32,
    /// Whether noise grows with the inverse root of brightness x cosine (photons that return).
    pub photons: bool,
    /// Distance over which noise is correlated, pixels.
    pub reach: f32,
}

/// A color camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorPreset {
    /// Exposure.
    pub exposure: f64,
    /// Time from the first row to the last: rolling shutter.
    pub readout: f64,
    /// Electrons of a white pixel at gain 1: shot noise.
    pub white_electrons: f32,
    /// Read noise, share of white.
    pub read: f32,
    /// Share of light that is missing in the corners.
    pub vignetting: f32,
    /// Share of a change of the scene's brightness that auto-exposure evens out, as an exponent.
    pub auto_exposure: f32,
}

/// What changes nothing, for tests and to build on.
pub const PERFECT: Preset = Preset {
    name: "perfect",
    native_columns: 640,
    near: 0.0,
    far: f32::INFINITY,
    axial: Axial {
        floor: 0.0,
        linear: 0.0,
        quadratic: 0.0,
        offset: 0.0,
        angle: 0.0,
        photons: false,
        reach: 0.0,
    },
    lateral: 0.0,
    lateral_reach: 0.0,
    inverse_step: 0.0,
    grid: None,
    flying: 0.0,
    baseline: 0.0,
    least_cosine: 0.0,
    least_signal: 0.0,
    depth_lag: 0.0,
    color: ColorPreset {
        exposure: 0.0,
        readout: 0.0,
        white_electrons: f32::INFINITY,
        read: 0.0,
        vignetting: 0.0,
        auto_exposure: 0.0,
    },
};

/// Structured light: Kinect for Xbox 360, 640x480.
pub const KINECT: Preset = Preset {
    name: "kinect",
    native_columns: 640,
    // K12: the sensor is for 0.5 to 5 m.
    near: 0.5,
    far: 5.0,
    axial: Axial {
        // N12: 0.0012 + 0.0019 (z - 0.4)², and the term of the angle.
        floor: 0.0012,
        quadratic: 0.0019,
        offset: 0.4,
        angle: 0.0001,
        // Chosen: disparity is found with a window of 9x9, whose values overlap.
        reach: 2.0,
        ..PERFECT.axial
    },
    // N12: 0.8 pixels, nearly the same for all angles below 60 degrees.
    lateral: 0.8,
    lateral_reach: 2.0,
    // K12: steps of 2.85e-5 z² cm, that is 7 cm at 5 m.
    inverse_step: 0.00285,
    // Chosen: few; the window decides for one surface.
    flying: 0.03,
    // K12: 7.5 cm between projector and infrared camera.
    baseline: 0.075,
    // N12 measures noise up to about 80 degrees; holes beyond. Cosine of 80 degrees.
    least_cosine: 0.17,
    // Chosen: a surface of brightness 0.03 is lost beyond 2.4 m.
    least_signal: 0.005,
    // Chosen: color and depth are not synchronised; up to half of 1/30 s.
    depth_lag: 0.010,
    color: ColorPreset {
        // Chosen: a lit room, 30 frames per second, a small CMOS sensor with a rolling shutter.
        exposure: 0.020,
        readout: 0.025,
        white_electrons: 2_000.0,
        read: 0.004,
        vignetting: 0.20,
        auto_exposure: 0.7,
    },
    ..PERFECT
};

/// Infrared stereo: Intel RealSense D435, 848x480.
pub const D435: Preset = Preset {
    name: "d435",
    native_columns: 848,
    // D4: least distance at 848x480, and the range that the sensor is sold for.
    near: 0.28,
    far: 10.0,
    axial: Axial {
        // D4: z² subpixel / (f b), with subpixel 0.08, b = 50 mm and f = 424 / tan(87°/2) = 447.
        quadratic: 0.08 / (447.0 * 0.05),
        // Chosen: the census window's values overlap; walls look wavy.
        reach: 4.0,
        ..PERFECT.axial
    },
    // Chosen: the window makes edges fatter and blobby.
    lateral: 1.5,
    lateral_reach: 4.0,
    // D4: disparity has 5 binary digits below the pixel: 1 / (32 f b).
    inverse_step: 1.0 / (32.0 * 447.0 * 0.05),
    // Chosen.
    flying: 0.25,
    // D4.
    baseline: 0.05,
    // Chosen: both eyes still see a pattern at 80 degrees.
    least_cosine: 0.17,
    // Chosen: stereo needs texture and not much light; only black is lost.
    least_signal: 0.0005,
    // Chosen: color is another sensor with its own shutter.
    depth_lag: 0.005,
    color: ColorPreset {
        // D4: color has a rolling shutter. Numbers chosen.
        exposure: 0.012,
        readout: 0.020,
        white_electrons: 4_000.0,
        read: 0.003,
        vignetting: 0.15,
        auto_exposure: 0.7,
    },
    ..PERFECT
};

/// Time of flight: Azure Kinect, narrow field of view, 640x576.
pub const TOF: Preset = Preset {
    name: "tof",
    native_columns: 640,
    // AK: 0.5 to 3.86 m.
    near: 0.5,
    far: 3.86,
    axial: Axial {
        // AK and T21: at most 17 mm, a few millimetres on bright walls, growing with distance and on
        // dark surfaces. The formula is that of photon noise; its factors are chosen for 1.5 mm at
        // 1 m and 5 mm at 3 m where brightness x cosine is 0.5.
        floor: 0.001,
        quadratic: 0.00045,
        photons: true,
        ..PERFECT.axial
    },
    // Chosen: half a pixel.
    lateral: 0.5,
    // T21 shows flying pixels around every object; the share is chosen.
    flying: 0.6,
    // Chosen: about 79 degrees.
    least_cosine: 0.19,
    // T21: dark materials are not measured. Chosen: brightness 0.05 is lost beyond 2.5 m.
    least_signal: 0.008,
    // AK: color and depth are synchronised; 0.16 ms between images of the infrared laser.
    depth_lag: 0.0,
    color: ColorPreset {
        // AK: the color camera has a rolling shutter. Numbers chosen.
        exposure: 0.016,
        readout: 0.020,
        white_electrons: 5_000.0,
        read: 0.002,
        vignetting: 0.12,
        auto_exposure: 0.7,
    },
    ..PERFECT
};

/// LiDAR of a phone, interpolated with the picture's help: ARKit scene depth, 256x192.
pub const PHONE: Preset = Preset {
    name: "phone",
    native_columns: 256,
    near: 0.1,
    // ARK: up to 5 m.
    far: 5.0,
    axial: Axial {
        // Chosen: 1 %, and smooth, since a network fills the gaps between few measured points.
        linear: 0.01,
        reach: 4.0,
        ..PERFECT.axial
    },
    // ARK: depth maps of 256x192; edges become slopes.
    grid: Some([256, 192]),
    // ARK: depth belongs to the frame's picture.
    depth_lag: 0.0,
    color: ColorPreset {
        // Chosen: a larger lens than the others', well corrected; stronger auto-exposure.
        exposure: 0.012,
        readout: 0.015,
        white_electrons: 8_000.0,
        read: 0.001,
        vignetting: 0.06,
        auto_exposure: 0.9,
    },
    ..PERFECT
};
