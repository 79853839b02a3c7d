//! Scan, sort, sum and gather against the standard library, for lengths around every border.

use crate::support;

use crate::oracle;
use lexsplat_gpu::primitives::gather::Gather;
use lexsplat_gpu::primitives::reduce::{Reduce, ReduceScratch, Summands};
use lexsplat_gpu::primitives::scan::Scan;
use lexsplat_gpu::primitives::sort::{Sort, SortShape};
use lexsplat_gpu::{Buffer, Gpu, Recorder};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const LENGTHS: [usize; 9] = [0, 1, 2, 63, 64, 65, 4096, 4097, 50_003];

fn numbers(len: usize, below: u32) -> Vec<u32> {
    let mut rng = ChaCha8Rng::seed_from_u64(len as u64);
    (0..len).map(|_| rng.random_range(0..below)).collect()
}

#[test]
fn scan_is_the_exclusive_prefix_sum() {
    let gpu = support::gpu();
    let scan = Scan::new(&gpu).expect("compiles");
    for len in LENGTHS {
        let mut values = numbers(len, 1000);
        let buffer = Buffer::from_slice(&gpu, "values", &values).expect("fits");
        let scratch = scan.scratch(&gpu, len).expect("fits");
        let mut recorder = Recorder::new(&gpu).expect("fits");
        scan.exclusive(&mut recorder, &buffer, len, &scratch);
        recorder.submit();
        let found = buffer.read(&gpu, len).expect("reads");
        assert_eq!(found, oracle::scan::exclusive(&values), "length {len}");
        if len > 1 {
            values[0] += 1;
            assert_ne!(found, oracle::scan::exclusive(&values), "one more must show");
        }
    }
}

#[test]
fn a_scan_that_is_too_large_stays_too_large() {
    let gpu = support::gpu();
    let scan = Scan::new(&gpu).expect("compiles");
    let values = vec![u32::MAX / 100; 300];
    let buffer = Buffer::from_slice(&gpu, "values", &values).expect("fits");
    let scratch = scan.scratch(&gpu, 300).expect("fits");
    let mut recorder = Recorder::new(&gpu).expect("fits");
    scan.exclusive(&mut recorder, &buffer, 300, &scratch);
    recorder.submit();
    let found = buffer.read(&gpu, 300).expect("reads");
    assert_eq!(found, oracle::scan::exclusive(&values));
    assert_eq!(found[299], u32::MAX);
}

/// Every way in which a sort is spread over threads.
const SHAPES: [SortShape; 3] =
    [SortShape::FEW_THREADS, SortShape::MANY_THREADS, SortShape { runs: 100, group: 16, bits: 7 }];

/// Sorts on the device, with room for a few more than there are.
fn sorted(
    gpu: &Gpu,
    shape: SortShape,
    (keys, values): (&[u32], &[u32]),
    bits: u32,
) -> (Vec<u32>, Vec<u32>) {
    let sort = Sort::with_shape(gpu, shape).expect("compiles");
    let buffers = sort.buffers(gpu, keys.len() + 100, bits).expect("fits");
    buffers.keys[0].write(gpu, 0, keys);
    buffers.values[0].write(gpu, 0, values);
    let count = Buffer::from_slice(gpu, "count", &[keys.len() as u32]).expect("fits");
    let mut recorder = Recorder::new(gpu).expect("fits");
    sort.sort(&mut recorder, &buffers, &count);
    recorder.submit();
    let read = |buffer: &Buffer<u32>| buffer.read(gpu, keys.len()).expect("reads");
    let side = buffers.side();
    (read(&buffers.keys[side]), read(&buffers.values[side]))
}

#[test]
fn sort_is_stable_for_any_length_and_width() {
    let gpu = support::gpu();
    for len in LENGTHS {
        let values: Vec<u32> = (0..len as u32).collect();
        for (bits, below) in [(32, u32::MAX), (9, 300), (1, 2), (4, 1)] {
            let keys = numbers(len, below);
            let wanted = oracle::sort::sort(&keys, &values, bits);
            for shape in SHAPES {
                let found = sorted(&gpu, shape, (&keys, &values), bits);
                assert_eq!(found, wanted, "length {len}, {bits} bits, {shape:?}");
            }
        }
    }
}

/// The most keys that are promised; a payload that ascends among equal keys is a stable sort's.
#[test]
fn sort_holds_for_twenty_million_keys() {
    let gpu = support::gpu();
    let len = 20_000_000;
    let keys: Vec<u32> = (0..len as u32).map(|i| i.wrapping_mul(2_654_435_761) >> 10).collect();
    let values: Vec<u32> = (0..len as u32).collect();
    let (sorted_keys, sorted_values) =
        sorted(&gpu, SortShape::of(gpu.tier()), (&keys, &values), 22);
    let pairs = || sorted_keys.iter().zip(&sorted_values);
    assert!(
        pairs().all(|(key, value)| keys[*value as usize] == *key),
        "payloads follow their keys"
    );
    let in_order = |(a, b): (_, _)| a < b;
    assert!(pairs().zip(pairs().skip(1)).all(in_order), "keys ascend, and payloads of equal keys");
    assert!(sorted_keys.windows(2).any(|pair| pair[0] == pair[1]), "there are equal keys");
    assert!(!keys.iter().zip(&values).zip(keys.iter().zip(&values).skip(1)).all(in_order));
}

#[test]
fn an_unstable_order_is_noticed() {
    let gpu = support::gpu();
    let keys = vec![5; 200];
    let values: Vec<u32> = (0..200).collect();
    let (_, mut found) = sorted(&gpu, SortShape::of(gpu.tier()), (&keys, &values), 8);
    assert_eq!(found, values);
    found.swap(3, 4);
    assert_ne!(found, oracle::sort::sort(&keys, &values, 8).1);
}

#[test]
fn reduce_sums_rows_component_by_component() {
    let gpu = support::gpu();
    let reduce = Reduce::new(&gpu).expect("compiles");
    for len in LENGTHS {
        let rows: Vec<[f32; 4]> =
            numbers(3 * len, 100).iter().map(|n| [*n as f32, 1.0, -(*n as f32), 0.5]).collect();
        let buffer = Buffer::from_slice(&gpu, "rows", &rows).expect("fits");
        let results = Buffer::from_slice(&gpu, "results", &[[7.0f32; 4]; 3]).expect("fits");
        let half = Buffer::from_slice(&gpu, "limit", &[len as u32 / 2]).expect("fits");
        let scratch = ReduceScratch::new(&gpu, len).expect("fits");
        for (row, limit, used) in [(0, None, len), (2, None, len), (1, Some(&half), len / 2)] {
            let mut recorder = Recorder::new(&gpu).expect("fits");
            let limit = limit.map(|limit: &Buffer<u32>| &**limit);
            let summands = Summands { rows: &buffer, len, stride: 3, row, limit };
            reduce.sum(&mut recorder, summands, &results, 1, &scratch);
            recorder.submit();
            // Small integers and halves: the sum is exact in f32.
            let mut sum = [0.0; 4];
            let summed = rows.iter().skip(row as usize).step_by(3).take(used);
            summed.for_each(|row| (0..4).for_each(|i| sum[i] += row[i]));
            let sum = if len == 0 { [7.0; 4] } else { sum };
            let found = results.read(&gpu, 3).expect("reads");
            assert_eq!(found, [[7.0; 4], sum, [7.0; 4]], "length {len}, row {row}");
        }
    }
}

#[test]
fn gather_picks_whole_elements() {
    let gpu = support::gpu();
    let gather = Gather::new(&gpu).expect("compiles");
    let from: Vec<[u32; 3]> = (0..100).map(|i| [i, 10 * i, 100 * i]).collect();
    let index = [99, 0, 7, 7];
    let buffers = (
        Buffer::from_slice(&gpu, "index", &index).expect("fits"),
        Buffer::from_slice(&gpu, "from", &from).expect("fits"),
        Buffer::<[u32; 3]>::new(&gpu, "to", 5).expect("fits"),
    );
    let mut recorder = Recorder::new(&gpu).expect("fits");
    gather.gather(&mut recorder, &buffers.0, 4, &buffers.1, &buffers.2, 3);
    recorder.submit();
    let found = buffers.2.read(&gpu, 5).expect("reads");
    assert_eq!(found, [from[99], from[0], from[7], from[7], [0; 3]]);
}

#[test]
fn a_recording_of_any_length_keeps_its_order() {
    let gpu = support::gpu();
    let gather = Gather::new(&gpu).expect("compiles");
    let index: Vec<u32> = (0..10).map(|i| (i + 1) % 10).collect();
    let values: Vec<u32> = (0..10).collect();
    let index = Buffer::from_slice(&gpu, "index", &index).expect("fits");
    let sides = [(); 2].map(|()| Buffer::from_slice(&gpu, "side", &values).expect("fits"));
    let mut recorder = Recorder::new(&gpu).expect("fits");
    for step in 0..603 {
        let (from, to) = (&sides[step % 2], &sides[1 - step % 2]);
        gather.gather(&mut recorder, &index, 10, from, to, 1);
    }
    recorder.submit();
    let found = sides[1].read(&gpu, 10).expect("reads");
    assert_eq!(found, (0..10).map(|i| (i + 603) % 10).collect::<Vec<u32>>());
}
