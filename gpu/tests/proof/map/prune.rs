//! Which Gaussians are removed, and that the others keep their order.

use super::{CHANNELS, LENGTHS, MIN_OPACITY, map, pick};
use crate::{oracle, support};

use lexsplat_gpu::map::prune;
use lexsplat_gpu::{Gpu, GpuError, HostGaussians};

/// Prunes on both sides; returns the map of the device and the indices that the oracle keeps.
fn pruned(gpu: &Gpu, host: &HostGaussians, min_opacity: f32) -> (HostGaussians, Vec<u32>) {
    let mut map = map(gpu, host);
    let removed = map.prune(min_opacity).expect("fits");
    assert_eq!(removed + map.len(), host.len());
    let arguments = prune::arguments(min_opacity, host.len()).expect("a number");
    (map.to_host().expect("reads"), oracle::prune::kept(host, &arguments))
}

#[test]
fn decisions_and_places_are_the_oracles() {
    let gpu = support::gpu();
    for len in LENGTHS {
        let host = support::scene(len as u64, len, CHANNELS, 0.05);
        for min_opacity in [0.0, MIN_OPACITY, 0.6] {
            let (found, mut kept) = pruned(&gpu, &host, min_opacity);
            assert!(found == pick(&host, &kept), "{len} gaussians, {min_opacity}");
            if min_opacity == 0.0 {
                assert_eq!(kept.len(), len, "an opacity of 0 is not below 0");
            } else if len > 1000 {
                assert!(len - kept.len() > 20, "{} of {len} stay", kept.len());
                let last = kept.len() - 1;
                kept.swap(0, last);
                assert!(found != pick(&host, &kept), "two that changed places must show");
            }
        }
    }
}

#[test]
fn one_head_is_enough_to_stay() {
    let gpu = support::gpu();
    let mut host = support::scene(5, 4, CHANNELS, 0.05);
    host.color.opacity_logits = vec![2.0, -9.0, 2.0, -9.0];
    host.language.opacity_logits = vec![2.0, 2.0, -9.0, -9.0];
    assert_eq!(pruned(&gpu, &host, MIN_OPACITY).1, [0, 1, 2]);
    let (found, _) = pruned(&gpu, &host, MIN_OPACITY);
    assert!(found == pick(&host, &[0, 1, 2]));
}

#[test]
fn a_limit_that_is_no_opacity_is_refused() {
    let gpu = support::gpu();
    let mut map = map(&gpu, &support::scene(5, 10, CHANNELS, 0.05));
    for wrong in [1.5, -0.1, f32::NAN, f32::INFINITY] {
        let error = map.prune(wrong).expect_err("no opacity");
        assert!(matches!(error, GpuError::BadValue { .. }), "{wrong}: {error}");
    }
}

#[test]
fn gaussians_that_are_not_numbers_are_removed() {
    let gpu = support::gpu();
    let mut host = support::scene(8, 200, CHANNELS, 0.05);
    for (i, bad) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        host.color.log_scales[10 + i][1] = bad;
        host.language.log_scales[20 + i][2] = bad;
        host.color.opacity_logits[30 + i] = bad;
        host.language.opacity_logits[30 + i] = bad;
        host.color.rotations[60 + i] = [bad; 4];
        host.means[70 + i][i] = bad;
    }
    let (found, kept) = pruned(&gpu, &host, MIN_OPACITY);
    assert_eq!(found.means, pick(&host, &kept).means);
    for gone in [10, 11, 30, 32, 70, 71, 72] {
        assert!(!kept.contains(&gone), "{gone} is not a number");
    }
    assert!(kept.contains(&12), "a scale of 0 is one");
}
