//! The optimiser steps that were taken on a keyframe.

use serde::{Deserialize, Serialize};

/// What one step optimises.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) struct StepKind {
    pub color: bool,
    pub language: bool,
}

/// When a keyframe was optimised against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(in super::super) struct Visits {
    /// Number of the map's last step that optimised its color; 0: none did.
    pub color: usize,
    /// Number of the map's last step that optimised its language; 0: none did.
    pub language: usize,
    /// Steps since then that optimised only color.
    pub color_alone: usize,
}

impl Visits {
    /// Notes that step `number` of the map optimises the keyframe.
    pub fn count(&mut self, kind: StepKind, number: usize) {
        if kind.color {
            self.color = number;
            self.color_alone += 1;
        }
        if kind.language {
            self.language = number;
            self.color_alone = 0;
        }
    }
}
