//! The properties of wild.rs on seeded bytes. A fuzzer looks for more: see gpu/fuzz/README.md.

use crate::support;
use crate::wild::{CHANNELS, Outcome, hold, scene_from_bytes};

use lexsplat_gpu::Trainer;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Seeded byte strings of many lengths; every second one is free of wild values, so that there is
/// something to see.
fn strings(count: u64) -> impl Iterator<Item = Vec<u8>> {
    (0..count).map(|seed| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let len = rng.random_range(0..2500);
        let most = if seed.is_multiple_of(2) { 255 } else { 239 };
        (0..len).map(|_| rng.random_range(0..=most)).collect()
    })
}

#[test]
fn any_bytes_make_a_scene_that_renders_and_trains() {
    let gpu = support::gpu();
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let mut counts = [0; 3];
    for (seed, bytes) in strings(400).enumerate() {
        println!("seed {seed}");
        counts[hold(&gpu, &mut trainer, &bytes) as usize] += 1;
    }
    println!("refused, empty, drawn: {counts:?}");
    let [refused, empty, drawn] = counts;
    assert!(refused > 20 && empty > 5 && drawn > 200, "all kinds occur: {counts:?}");
}

#[test]
fn the_bytes_reach_wild_values_in_every_array() {
    let mut wild = [0; 9];
    for bytes in strings(100) {
        let (scene, _) = scene_from_bytes(&bytes);
        let heads = [&scene.color, &scene.language];
        let odd = |values: &[f32]| values.iter().any(|v| !v.is_finite() || v.abs() > 1e3);
        wild[0] += usize::from(odd(&scene.means.concat()));
        for (i, head) in heads.iter().enumerate() {
            wild[1 + 4 * i] += usize::from(odd(&head.rotations.concat()));
            wild[2 + 4 * i] += usize::from(odd(&head.log_scales.concat()));
            wild[3 + 4 * i] += usize::from(odd(&head.opacity_logits));
            wild[4 + 4 * i] += usize::from(odd(&head.features));
        }
    }
    assert!(wild.iter().all(|count| *count > 10), "{wild:?}");
}

/// The check itself must be able to tell: a picture of no pixels, one of nothing, one of something.
#[test]
fn the_outcomes_are_told_apart() {
    let gpu = support::gpu();
    let mut trainer = Trainer::new(&gpu, CHANNELS).expect("compiles");
    let outcome = |trainer: &mut Trainer, bytes: &[u8]| hold(&gpu, trainer, bytes);
    assert_eq!(outcome(&mut trainer, &[]), Outcome::Refused);
    // A tame camera is one byte and eleven numbers of two; then come width and height.
    let mut bytes = vec![1; 25];
    (bytes[23], bytes[24]) = (16, 16);
    assert_eq!(outcome(&mut trainer, &bytes), Outcome::Empty, "{:?}", scene_from_bytes(&bytes));
    bytes.extend([120; 200]);
    assert_eq!(outcome(&mut trainer, &bytes), Outcome::Drawn, "{:?}", scene_from_bytes(&bytes));
}
