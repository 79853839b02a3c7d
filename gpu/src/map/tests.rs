//! Every array follows its Gaussian: each value on the device names the Gaussian it belongs to.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::device::{Buffer, Gpu};
use crate::map::arrays::Growth;
use crate::map::{Gaussians, HostGaussians, HostHead, Parameters};
use crate::shader::layout::Row;

const CHANNELS: usize = 6;

fn gpu() -> Gpu {
    Gpu::new(None).expect("these tests need a vulkan adapter")
}

fn head(len: usize, channels: usize) -> HostHead {
    HostHead {
        rotations: (0..len).map(|i| [1.0, i as f32, 0.0, 0.0]).collect(),
        log_scales: vec![[-4.0; 3]; len],
        opacity_logits: vec![1.0; len],
        features: (0..len * channels).map(|i| (i / channels) as f32).collect(),
        channels,
    }
}

fn kinds(map: &Gaussians) -> [&Parameters; 5] {
    let arrays = map.arrays.as_ref().expect("there are arrays");
    let (color, language) = (&arrays.color, &arrays.language);
    [&arrays.means, &color.geometry, &color.features, &language.geometry, &language.features]
}

fn steps(map: &Gaussians) -> [&Buffer<u32>; 2] {
    let arrays = map.arrays.as_ref().expect("there are arrays");
    [&arrays.color.steps, &arrays.language.steps]
}

/// The rows of one array of Gaussian `i`, kind by kind.
fn marked(i: usize, array: usize, rows: usize) -> Vec<Row> {
    (0..rows).map(|row| [1.0 + i as f32, array as f32, row as f32, 0.5]).collect()
}

/// A map in which every row of state holds the index of its Gaussian.
fn map(gpu: &Gpu, len: usize) -> Gaussians {
    let mut map = Gaussians::new(gpu, CHANNELS);
    let mut host = HostGaussians {
        means: (0..len).map(|i| [i as f32; 3]).collect(),
        color: head(len, 3),
        language: head(len, CHANNELS),
    };
    if len > 3 {
        host.means[2] = [f32::NAN, 0.0, 0.0];
    }
    map.append(&host).expect("fits");
    for (array, kind) in kinds(&map).into_iter().enumerate() {
        for (moment, buffer) in [&kind.first, &kind.second].into_iter().enumerate() {
            let of = |i| marked(i, 2 * array + moment, kind.rows);
            buffer.write(gpu, 0, &(0..len).flat_map(of).collect::<Vec<_>>());
        }
    }
    for (head, buffer) in steps(&map).into_iter().enumerate() {
        let of = |i: usize| (10 * i + head + 1) as u32;
        buffer.write(gpu, 0, &(0..len).map(of).collect::<Vec<_>>());
    }
    map
}

/// Makes the Gaussians without a flag transparent in both heads.
fn fade(gpu: &Gpu, map: &Gaussians, keep: &[bool]) {
    let arrays = map.arrays.as_ref().expect("there are arrays");
    for head in [&arrays.color, &arrays.language] {
        let mut rows = head.geometry.values.read(gpu, 2 * keep.len()).expect("reads");
        for (row, keep) in rows.iter_mut().skip(1).step_by(2).zip(keep) {
            row[3] = if *keep { 1.0 } else { -9.0 };
        }
        head.geometry.values.write(gpu, 0, &rows);
    }
}

/// Makes the Gaussians without a flag transparent, and removes them.
fn remove(gpu: &Gpu, map: &mut Gaussians, keep: &[bool]) {
    fade(gpu, map, keep);
    let removed = keep.iter().filter(|keep| !**keep).count();
    assert_eq!(map.prune(0.1).expect("fits"), removed);
}

/// Returns an error unless the map is, array by array, what `source` makes of the marked map.
fn compare(gpu: &Gpu, map: &Gaussians, source: &[usize]) -> Result<(), String> {
    let len = source.len();
    if map.len() != len {
        return Err(format!("{} gaussians, wanted {len}", map.len()));
    }
    for (array, kind) in kinds(map).into_iter().enumerate() {
        for (moment, buffer) in [&kind.first, &kind.second].into_iter().enumerate() {
            let found = buffer.read(gpu, kind.rows * len).expect("reads");
            let wanted = source.iter().flat_map(|i| marked(*i, 2 * array + moment, kind.rows));
            if !found.iter().copied().eq(wanted) {
                return Err(format!("moment {moment} of array {array}"));
            }
        }
    }
    for (head, buffer) in steps(map).into_iter().enumerate() {
        let wanted = source.iter().map(|i| (10 * i + head + 1) as u32);
        if !buffer.read(gpu, len).expect("reads").into_iter().eq(wanted) {
            return Err(format!("steps of head {head}"));
        }
    }
    let host = map.to_host().expect("reads");
    let owner = |features: &[f32], channels| {
        features.iter().step_by(channels).map(|f| *f as usize).collect::<Vec<_>>()
    };
    let same = owner(&host.color.features, 3) == source
        && owner(&host.language.features, CHANNELS) == source
        && host.color.rotations.iter().map(|q| q[1] as usize).eq(source.iter().copied());
    if same { Ok(()) } else { Err("parameters".to_owned()) }
}

fn all_of(len: usize) -> Vec<usize> {
    (0..len).collect()
}

#[test]
fn pruning_moves_state_with_its_gaussian() {
    let gpu = gpu();
    let mut map = map(&gpu, 300);
    compare(&gpu, &map, &all_of(300)).expect("as it was made");
    // The mean of Gaussian 2 is not a number; see [`map`].
    let keep: Vec<bool> = (0..300).map(|i| i % 5 != 1 && i != 2).collect();
    remove(&gpu, &mut map, &keep);
    let mut wanted = all_of(300);
    wanted.retain(|i| keep[*i]);
    compare(&gpu, &map, &wanted).expect("state follows");
    wanted.swap(3, 4);
    assert!(compare(&gpu, &map, &wanted).is_err(), "two that changed places must show");
}

#[test]
fn morton_order_moves_state_and_puts_means_that_are_not_finite_last() {
    let gpu = gpu();
    let mut map = map(&gpu, 200);
    map.reorder_morton().expect("fits");
    let mut wanted: Vec<_> = all_of(200).into_iter().filter(|i| *i != 2).collect();
    wanted.push(2);
    compare(&gpu, &map, &wanted).expect("on a diagonal the order is that of the axis");
}

#[test]
fn a_map_that_grew_in_part_is_as_it_was() {
    let gpu = gpu();
    let mut map = map(&gpu, 100);
    let arrays = map.arrays.as_mut().expect("there are arrays");
    let growth = Growth { gpu: &gpu, len: 100, capacity: 5000 };
    for buffer in [&mut arrays.means.values, &mut arrays.means.second] {
        growth.grow(buffer, "means", 1).expect("fits");
    }
    compare(&gpu, &map, &all_of(100)).expect("nothing moved");
    map.reserve(3000).expect("the rest grows, what has room stays");
    compare(&gpu, &map, &all_of(100)).expect("nothing moved");
    assert_eq!(map.capacity(), 3000);
    remove(&gpu, &mut map, &[false; 100]);
    compare(&gpu, &map, &[]).expect("an empty map");
}

/// Peak of the bytes allocated on the device while `run` runs, sampled by another thread. `run`
/// gets the number of samples so far.
fn peak(gpu: &Gpu, run: impl FnOnce(&AtomicU64)) -> u64 {
    let (done, most, looks) = (AtomicBool::new(false), AtomicU64::new(0), AtomicU64::new(0));
    let look = || {
        let report = gpu.device().generate_allocator_report().expect("vulkan keeps accounts");
        most.fetch_max(report.total_allocated_bytes, Ordering::Relaxed);
        looks.fetch_add(1, Ordering::Relaxed);
    };
    std::thread::scope(|scope| {
        let watch = || {
            while !done.load(Ordering::Relaxed) {
                look();
            }
        };
        let named = std::thread::Builder::new().name("memory".to_owned());
        named.spawn_scoped(scope, watch).expect("a thread starts");
        run(&looks);
        gpu.wait().expect("the device is there");
        look();
        done.store(true, Ordering::Relaxed);
    });
    most.load(Ordering::Relaxed)
}

#[test]
fn rearranging_and_growing_need_memory_for_one_more_array() {
    let gpu = gpu();
    let len = 100_000;
    let mut map = map(&gpu, len);
    remove(&gpu, &mut map, &(0..len).map(|i| i != 2).collect::<Vec<_>>()); // Compiles the kernels.
    let len = map.len();
    let bytes = || {
        gpu.wait().expect("the device is there");
        peak(&gpu, |_| ())
    };
    let before = bytes();
    let map_bytes = map.device_bytes();
    let keep: Vec<bool> = (0..len).map(|i| i % 10 != 3).collect();
    let report = |name: &str, peak: u64, resting: u64| {
        let share = (peak as f64 - resting as f64) / map_bytes as f64;
        println!("{name}: {:.1} % of {map_bytes} bytes more", 100.0 * share);
        share
    };
    let morton = peak(&gpu, |_| map.reorder_morton().expect("fits"));
    let morton = report("morton", morton, before);
    fade(&gpu, &map, &keep);
    bytes();
    let mut removed = 0;
    let prune = peak(&gpu, |_| removed = map.prune(0.1).expect("fits"));
    assert_eq!(removed, keep.iter().filter(|keep| !**keep).count());
    let prune = report("prune", prune, before);
    let grown = peak(&gpu, |_| map.reserve(2 * len).expect("fits"));
    let growth = report("growth", grown, bytes());
    // Two rows, 32 bytes of 392 per Gaussian, are the widest array here; lists, staging and what
    // the device has not given back yet add to it. Whatever the other thread misses is less.
    for (share, most) in [(morton, 0.2), (prune, 0.15), (growth, 0.15)] {
        assert!(share < most, "{share} of the map, at most {most}");
    }
    let resting = bytes();
    let copied = peak(&gpu, |looks| {
        let copy = Buffer::<u8>::new(&gpu, "second copy", map_bytes as usize).expect("fits");
        let before = looks.load(Ordering::Relaxed);
        while looks.load(Ordering::Relaxed) < before + 2 {
            std::thread::yield_now();
        }
        drop(copy);
    });
    assert!(report("a copy", copied, resting) >= 1.0, "a second copy must show");
}
