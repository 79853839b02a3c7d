//! Tiers: the sets of GPU features that kernels may use. The facts of an adapter determine the
//! tiers that it offers, best first. A self-test decides later which one a device gets.

/// Width of the subgroups that the software tier relies on: what Mesa's llvmpipe has on x86 with
/// AVX2.
pub const SOFTWARE_SUBGROUP: u32 = 8;

/// Fewest lanes of a subgroup that is of any use.
const FEWEST_LANES: u32 = 4;

/// The set of features that kernels may use. Every tier has workgroup memory and barriers. No tier
/// has atomics, since the order of their results is undefined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tier {
    /// The processor pretends to be a GPU: few threads that handle many pixels each do best.
    /// Subgroups have [`SOFTWARE_SUBGROUP`] lanes, in the order of the threads.
    Software,
    /// Nothing besides: no subgroup operations.
    Portable,
    /// A GPU with subgroups of a size between these, a power of two that the kernel learns when it
    /// runs; their lanes are in the order of the threads.
    Subgroup {
        /// Fewest lanes.
        min: u32,
        /// Most lanes.
        max: u32,
    },
}

impl Tier {
    /// `software`, `portable` or `subgroup`; `LEXSPLAT_TIER` takes these.
    pub fn name(self) -> &'static str {
        match self {
            Tier::Software => "software",
            Tier::Portable => "portable",
            Tier::Subgroup { .. } => "subgroup",
        }
    }

    /// Fewest and most lanes of a subgroup; none without subgroup operations.
    pub fn subgroup(self) -> Option<(u32, u32)> {
        match self {
            Tier::Software => Some((SOFTWARE_SUBGROUP, SOFTWARE_SUBGROUP)),
            Tier::Portable => None,
            Tier::Subgroup { min, max } => Some((min, max)),
        }
    }

    /// Whether lists are made by counting the hits of each run in each tile: better where a few
    /// threads do all the work. Elsewhere hits are sorted.
    pub fn counts_tiles(self) -> bool {
        self == Tier::Software
    }

    /// Whether kernels read their arguments from a storage buffer instead of a uniform one. Mesa's
    /// software driver compiles a kernel anew for each value of a uniform that a branch depends on, and
    /// keeps every version: memory grew by 0.8 MB with each new view.
    pub(crate) fn stores_arguments(self) -> bool {
        self == Tier::Software
    }

    /// Optional features that a device of this tier must have.
    pub(crate) fn features(self) -> wgpu::Features {
        self.subgroup().map_or(wgpu::Features::empty(), |_| wgpu::Features::SUBGROUP)
    }
}

/// What an adapter says of itself, as far as tiers go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facts {
    /// It is the processor.
    pub cpu: bool,
    /// Fewest and most lanes of a subgroup; none without subgroup operations.
    pub subgroup: Option<(u32, u32)>,
}

impl Facts {
    pub fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let has = adapter.features().contains(wgpu::Features::SUBGROUP);
        Self {
            cpu: info.device_type == wgpu::DeviceType::Cpu,
            subgroup: has.then_some((info.subgroup_min_size, info.subgroup_max_size)),
        }
    }

    /// The tiers that the adapter may have, best first; the last is always the portable one. With
    /// them, why there is none better, if so.
    pub fn tiers(self) -> (Vec<Tier>, Option<String>) {
        let width = SOFTWARE_SUBGROUP;
        match self.subgroup {
            None => (vec![Tier::Portable], Some("no subgroup operations".to_owned())),
            Some((min, max)) if min < FEWEST_LANES => {
                let why = format!("subgroups of {min} to {max} lanes, needed {FEWEST_LANES}");
                (vec![Tier::Portable], Some(why))
            }
            Some((min, max)) if !self.cpu => {
                (vec![Tier::Subgroup { min, max }, Tier::Portable], None)
            }
            Some((min, max)) if (min, max) == (width, width) => {
                (vec![Tier::Software, Tier::Portable], None)
            }
            Some((min, max)) => (
                vec![Tier::Portable],
                Some(format!("subgroups of {min} to {max} lanes on a processor, not of {width}")),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Facts, Tier};

    #[test]
    fn adapter_facts_decide_and_portable_is_always_offered() {
        let tiers = |cpu, subgroup| Facts { cpu, subgroup }.tiers();
        let gpu = Tier::Subgroup { min: 32, max: 64 };
        assert_eq!(tiers(false, Some((32, 64))), (vec![gpu, Tier::Portable], None));
        assert_eq!(tiers(true, Some((8, 8))), (vec![Tier::Software, Tier::Portable], None));
        let (other, why) = tiers(true, Some((4, 8)));
        assert_eq!(other, [Tier::Portable]);
        assert!(why.is_some_and(|why| why.contains("4 to 8")));
        assert_eq!(tiers(false, Some((2, 32))).0, [Tier::Portable]);
        for cpu in [true, false] {
            let (none, why) = tiers(cpu, None);
            assert_eq!(none, [Tier::Portable]);
            assert!(why.is_some_and(|why| why.contains("no subgroup")));
        }
    }
}
