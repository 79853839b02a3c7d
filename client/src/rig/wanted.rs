//! Which topics are to be used, as users say it: `color=/topic&depth=/topic&world=odom`.

use std::fmt;

/// Topics and frames of coordinates to use; what is absent is chosen by content.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// The topic of color.
    pub color: Option<String>,
    /// The topic of depth.
    pub depth: Option<String>,
    /// The topic of the color camera's calibration.
    pub info: Option<String>,
    /// The topic of the depth camera's calibration.
    pub depth_info: Option<String>,
    /// The topic of poses (transforms, odometry or poses), or `none`.
    pub pose: Option<String>,
    /// The frame of coordinates that poses of a topic without names are of; the color camera's if absent.
    pub pose_frame: Option<String>,
    /// The frame of coordinates that is the map's world.
    pub world: Option<String>,
    /// Whether depth is registered to color.
    pub registered: Option<bool>,
}

/// The names of the options.
const OPTIONS: &str = "color, depth, info, depth_info, pose, pose_frame, world, registered";

impl Wanted {
    /// Reads `option=value&option=value`.
    ///
    /// # Errors
    /// Which option is not known, or what its value may be, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut wanted = Self::default();
        for option in text.split('&').filter(|option| !option.is_empty()) {
            let (name, value) = option.split_once('=').unwrap_or((option, ""));
            if value.is_empty() {
                return Err(format!("{name}: expected {name}=VALUE"));
            }
            if name == "registered" {
                wanted.registered = Some(match value {
                    "yes" => true,
                    "no" => false,
                    other => return Err(format!("registered: expected yes or no, found {other}")),
                });
                continue;
            }
            let Some((_, field)) = wanted.fields().into_iter().find(|(known, _)| *known == name)
            else {
                return Err(format!("expected one of {OPTIONS}, found {name:?}"));
            };
            *field = Some(value.to_owned());
        }
        Ok(wanted)
    }

    fn fields(&mut self) -> [(&'static str, &mut Option<String>); 7] {
        [
            ("color", &mut self.color),
            ("depth", &mut self.depth),
            ("info", &mut self.info),
            ("depth_info", &mut self.depth_info),
            ("pose", &mut self.pose),
            ("pose_frame", &mut self.pose_frame),
            ("world", &mut self.world),
        ]
    }
}

impl fmt::Display for Wanted {
    /// As [`Wanted::parse`] reads it; nothing if nothing is wanted.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut copy = self.clone();
        let named = copy.fields().into_iter();
        let mut options: Vec<String> =
            named.filter_map(|(name, value)| Some(format!("{name}={}", value.as_ref()?))).collect();
        let yes_or_no = |is: bool| if is { "yes" } else { "no" };
        options.extend(self.registered.map(|is| format!("registered={}", yes_or_no(is))));
        f.write_str(&options.join("&"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_and_written() {
        let text = "color=/a/image&depth=/b&pose=none&world=odom&registered=no";
        let wanted = Wanted::parse(text).unwrap();
        assert_eq!(wanted.color.as_deref(), Some("/a/image"));
        assert_eq!((wanted.registered, wanted.info.as_deref()), (Some(false), None));
        assert_eq!(wanted.to_string(), text);
        assert_eq!(Wanted::parse("").unwrap(), Wanted::default());
        for (text, error) in [
            ("hue=/a", "expected one of color, depth, info"),
            ("color", "color: expected color=VALUE"),
            ("registered=maybe", "registered: expected yes or no, found maybe"),
        ] {
            assert!(Wanted::parse(text).unwrap_err().starts_with(error), "{text}");
        }
    }
}
