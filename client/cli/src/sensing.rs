//! Options that several commands share: a simulated sensor, a shaking camera and black frames on top
//! of a data set.

use crate::dataset::{DatasetSpec, tell};
use anyhow::{Result, bail};
use clap::ValueEnum;
use lexsplat_client::dataset::{Dataset, DatasetError, FrameRange};
use lexsplat_client::stream::Poses;
use lexsplat_synthetic::sensor::{Blackout, D435, KINECT, PHONE, Preset, Sensed, TOF};

/// Largest shaking, degrees.
const MOST_DEGREES: f64 = 10.0;

/// A sensor that can be simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Sensor {
    /// Structured light: Kinect for Xbox 360
    Kinect,
    /// Infrared stereo: Intel RealSense D435
    D435,
    /// Time of flight: Azure Kinect
    Tof,
    /// LiDAR and camera of a phone
    Phone,
}

impl Sensor {
    fn preset(self) -> Preset {
        match self {
            Self::Kinect => KINECT,
            Self::D435 => D435,
            Self::Tof => TOF,
            Self::Phone => PHONE,
        }
    }
}

/// What is done to the frames of a clean data set before they are sent.
#[derive(Clone, Debug, clap::Args)]
pub struct Sensing {
    /// Simulate a sensor: noise, holes and edges of its depth; noise, blur, rolling shutter and
    /// exposure of its color. For clean, rendered data; scores are against the clean frames
    #[arg(long, value_enum, value_name = "NAME")]
    sensor: Option<Sensor>,
    /// Seed of the sensor's noise: the same seed gives the same bytes
    #[arg(long, value_name = "N", default_value_t = 1)]
    sensor_seed: u64,
    /// Shake the camera about each axis, degrees (root mean square); only rendered rooms can
    #[arg(long, value_name = "DEGREES", value_parser = degrees)]
    shake: Option<f64>,
    /// Send these frames black and without depth: START..END or every:N, counted from 0 among the
    /// frames that are sent
    #[arg(long, value_name = "START..END")]
    blackout: Option<Blackout>,
}

fn degrees(text: &str) -> Result<f64, String> {
    let wrong = || format!("expected 0 to {MOST_DEGREES} degrees, found {text:?}");
    let value: f64 = text.parse().map_err(|_| wrong())?;
    if (0.0..=MOST_DEGREES).contains(&value) { Ok(value) } else { Err(wrong()) }
}

impl Sensing {
    /// Opens the data set with all of it; without the frames that lack a pose, if poses are to be given. Says
    /// on standard error what was assumed and left out.
    ///
    /// # Errors
    /// As [`DatasetSpec::open`], and if a recording is to be shaken.
    pub fn open(
        &self,
        spec: &DatasetSpec,
        range: FrameRange,
        poses: Poses,
    ) -> Result<Box<dyn Dataset>> {
        if self.shake.is_some() && !matches!(spec, DatasetSpec::Synthetic { .. }) {
            bail!(
                "--shake: {spec} is recorded, and a recording cannot be taken again: leave it out, or \
                 use synthetic:SEED"
            );
        }
        let whole = spec.whole(self.shake_radians(), poses)?;
        if self.sensor.is_some() && !whole.cameras().are_registered() {
            bail!("--sensor: {spec} has real lenses already: leave it out");
        }
        let dataset = self.applied(whole, range)?;
        tell(&*dataset);
        Ok(dataset)
    }

    /// Shaking about each axis, radians.
    pub fn shake_radians(&self) -> f64 {
        self.shake.unwrap_or(0.0).to_radians()
    }

    /// A part of a data set, with sensor and black frames. The sensor sees the whole data set, since
    /// the camera's motion is that between neighbours.
    ///
    /// # Errors
    /// [`DatasetError`] if `range` leaves no frames.
    pub fn applied(
        &self,
        whole: Box<dyn Dataset>,
        range: FrameRange,
    ) -> Result<Box<dyn Dataset>, DatasetError> {
        let sensed: Box<dyn Dataset> = match self.sensor {
            Some(sensor) => {
                Box::new(Sensed::new(whole, sensor.preset(), self.sensor_seed, range.start))
            }
            None => whole,
        };
        let part = range.of(sensed)?;
        Ok(match self.blackout {
            Some(blackout) => blackout.of(part),
            None => part,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use std::num::NonZeroUsize;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        sensing: Sensing,
    }

    fn parsed(words: &str) -> Result<Sensing, String> {
        let words = ["command"].into_iter().chain(words.split_whitespace());
        Command::try_parse_from(words).map(|c| c.sensing).map_err(|error| error.to_string())
    }

    fn range() -> FrameRange {
        let stride = NonZeroUsize::new(3).unwrap();
        FrameRange { start: 4, end: Some(12), stride, ..FrameRange::default() }
    }

    #[test]
    fn without_options_nothing_is_changed() {
        let spec = DatasetSpec::Synthetic { seed: 3 };
        let plain = spec.open(range()).unwrap();
        let same = parsed("").unwrap().open(&spec, range(), Poses::Given).unwrap();
        assert_eq!((same.len(), same.sequence(1)), (plain.len(), plain.sequence(1)));
        assert_eq!(same.moment(1).unwrap(), plain.moment(1).unwrap());
        assert_eq!(same.simulated(), None);
    }

    #[test]
    fn a_sensor_shaking_and_black_frames_are_put_on_a_part() {
        let spec = DatasetSpec::Synthetic { seed: 3 };
        let plain = spec.open(range()).unwrap();
        let sensing = parsed("--sensor tof --sensor-seed 5 --shake 1.5 --blackout 1..2").unwrap();
        let part = sensing.open(&spec, range(), Poses::Given).unwrap();
        let words = "camera shaken by 1.50 degrees, sensor tof with seed 5, frames 1..2 black";
        assert_eq!((part.len(), part.simulated().as_deref()), (3, Some(words)));
        let pose = |dataset: &dyn Dataset| dataset.moment(1).unwrap().world_from_camera.unwrap();
        let turned = pose(&*part).rotation.angle_to(&pose(&*plain).rotation);
        assert!(turned > 1e-3, "{turned}");
        assert_ne!(part.frame(0).unwrap().depth, part.clean_frame(0).unwrap().depth);
        assert!(part.frame(1).unwrap().depth.bytes.len() < 2000, "black");
        assert_eq!(part.frame(2).unwrap().sequence, 10);
    }

    #[test]
    fn wrong_options_say_what_is_expected() {
        for (words, expected) in [
            ("--sensor webcam", "kinect, d435, tof, phone"),
            ("--shake 11", "expected 0 to 10 degrees"),
            ("--shake -1", "unexpected argument"),
            ("--blackout 4", "expected START..END or every:N"),
        ] {
            let error = parsed(words).unwrap_err();
            assert!(error.contains(expected), "{words}: {error}");
        }
        let recorded: DatasetSpec = "tum:desk".parse().unwrap();
        let shaken = parsed("--shake 1").unwrap();
        let error = shaken.open(&recorded, range(), Poses::Given).err().unwrap();
        assert!(error.to_string().contains("--shake: tum:desk is recorded"), "{error}");
    }
}
