//! Losses and Adam against their oracles, kernel by kernel.

use crate::support;

use crate::oracle;
use lexsplat_gpu::pass::order::Ranks;
use lexsplat_gpu::primitives::sort::Sort;
use lexsplat_gpu::shader::layout::{
    BETA_FIRST, BETA_SECOND, HitCount, LOG_BETA_FIRST, LOG_BETA_SECOND,
};
use lexsplat_gpu::train::adam::{Adam, ParameterGradients, RowRates, SeenGaussians, Youth};
use lexsplat_gpu::train::loss::{Loss, LossBuffers, ScaleLoss};
use lexsplat_gpu::{Buffer, ColorTarget, LossWeights, Parameters, Recorder};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn color_loss_matches_the_oracle() {
    let gpu = support::gpu();
    let (loss, pixels) = (Loss::new(&gpu).expect("compiles"), 11 * 7);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let image: Vec<[f32; 4]> = (0..pixels).map(|_| std::array::from_fn(|_| rng.random())).collect();
    let rgb: Vec<u8> = (0..3 * pixels).map(|_| rng.random()).collect();
    let depth: Vec<f32> = (0..pixels).map(|i| [0.0, f32::NAN, 0.5, 2.0][i % 4]).collect();
    let target = ColorTarget::masked(&gpu, 11, 7, &rgb, &depth, |i| i % 5 != 0).expect("fits");
    let buffers = (
        Buffer::from_slice(&gpu, "image", &image).expect("fits"),
        Buffer::<[f32; 4]>::new(&gpu, "gradients", pixels).expect("fits"),
        Buffer::<[f32; 4]>::new(&gpu, "terms", loss.color_terms([11, 7])).expect("fits"),
    );
    let left_out = Buffer::<u32>::new(&gpu, "left out", 2).expect("fits");
    let weights = LossWeights { color: 0.9, depth: 0.3, ..LossWeights::default() };
    let mut recorder = Recorder::new(&gpu).expect("fits");
    let exposure = [0.1f32, -0.02];
    let outputs = LossBuffers { image: &buffers.0, gradients: &buffers.1, terms: &buffers.2 };
    loss.color(&mut recorder, &target, exposure, &weights, &left_out, outputs);
    recorder.submit();
    let (found, terms) = (buffers.1.read(&gpu, pixels), buffers.2.read(&gpu, buffers.2.len()));
    let (found, terms) = (found.expect("reads"), terms.expect("reads"));

    let values = |channels: std::ops::Range<usize>| -> Vec<f64> {
        image.iter().flat_map(|row| row[channels.clone()].to_vec()).map(f64::from).collect()
    };
    let colors: Vec<_> = (0..3 * pixels)
        .map(|i| (i / 3 % 5 != 0).then(|| f64::from(f32::from(rgb[i]) / 255.0)))
        .collect();
    let depths: Vec<_> = depth.iter().map(|d| (*d > 0.0).then_some(f64::from(*d))).collect();
    let shown = |exposure| oracle::loss::exposed(0.9f32.into(), exposure, &values(0..3), &colors);
    let exposure = exposure.map(f64::from);
    let (color, d_color, d_exposure) = shown(exposure);
    let (depth, d_depth) = oracle::loss::mean_absolute(0.3f32.into(), &values(3..4), &depths);
    let sum = |i: usize| terms.iter().map(|term| f64::from(term[i])).sum::<f64>();
    assert!((sum(0) - color).abs() < 1e-6 && (sum(1) - depth).abs() < 1e-6);
    println!("loss: {:.1e} {:.1e}", sum(0) - color, sum(1) - depth);
    for (pixel, row) in found.iter().enumerate() {
        let wanted = [&d_color[3 * pixel..3 * pixel + 3], &d_depth[pixel..=pixel]].concat();
        for (found, wanted) in row.iter().zip(wanted) {
            assert!((f64::from(*found) - wanted).abs() < 1e-8, "pixel {pixel}: {found} {wanted}");
        }
    }
    for (i, d_wanted) in d_exposure.into_iter().enumerate() {
        // Measured on llvmpipe: 3e-8.
        assert!((sum(2 + i) - d_wanted).abs() < 1e-6, "exposure: {} {d_wanted}", sum(2 + i));
        let moved = |step: f64| {
            shown(std::array::from_fn(|j| exposure[j] + if i == j { step } else { 0.0 })).0
        };
        let difference = (moved(1e-7) - moved(-1e-7)) / 2e-7;
        assert!((difference - d_wanted).abs() < 1e-5, "exposure: {difference} {d_wanted}");
        assert!(d_wanted.abs() > 1e-3, "the gradient is not small");
    }
    assert!((sum(0) - shown([0.101, -0.02]).0).abs() > 1e-6, "another exposure must show");
}

#[test]
fn shape_losses_match_the_oracle_and_its_gradient_matches_differences() {
    let gpu = support::gpu();
    let scene = support::scene(7, 50, 15, 0.1);
    let loss = Loss::new(&gpu).expect("compiles");
    let ranks = Ranks::all(&gpu, &Sort::new(&gpu).expect("compiles"), 50).expect("fits");
    let rows = |scales: &[[f32; 3]]| -> Vec<[f32; 4]> {
        scales.iter().flat_map(|s| [[0.0; 4], [s[0], s[1], s[2], 0.0]]).collect()
    };
    let buffer = |rows: &[[f32; 4]]| Buffer::from_slice(&gpu, "rows", rows).expect("fits");
    let [c, f] = [&scene.color, &scene.language].map(|head| buffer(&rows(&head.log_scales)));
    let ones = vec![[1.0f32; 4]; 100];
    let (d_c, d_f, terms_c, terms_f) = (buffer(&ones), buffer(&ones), buffer(&ones), buffer(&ones));
    let mut recorder = Recorder::new(&gpu).expect("fits");
    let (weight, count, ranks) = (10.0, 50, &ranks);
    let isotropic = ScaleLoss { weight, count, ranks, color: &c, gradients: &d_c, terms: &terms_c };
    loss.isotropic(&mut recorder, isotropic);
    let tie = ScaleLoss { gradients: &d_f, terms: &terms_f, ..isotropic };
    loss.tie(&mut recorder, &f, tie);
    recorder.submit();

    let wide = |scales: &[[f32; 3]]| scales.iter().map(|s| s.map(f64::from)).collect::<Vec<_>>();
    let (wide_c, wide_f) = (wide(&scene.color.log_scales), wide(&scene.language.log_scales));
    let isotropic = |scales: &[[f64; 3]]| oracle::loss::isotropic(10.0, scales);
    let tie = |scales: &[[f64; 3]]| oracle::loss::tie(10.0, &wide_c, scales);
    for (scales, terms, gradients, oracle) in [
        (&wide_c, &terms_c, &d_c, &isotropic as &dyn Fn(&[[f64; 3]]) -> (f64, Vec<[f64; 3]>)),
        (&wide_f, &terms_f, &d_f, &tie),
    ] {
        let (wanted, d_wanted) = oracle(scales);
        let sum: f32 = terms.read(&gpu, 50).expect("reads").iter().map(|term| term[0]).sum();
        println!("shape: {:.1e}", f64::from(sum) - wanted);
        assert!((f64::from(sum) - wanted).abs() < 1e-5, "{sum} {wanted}");
        let found = gradients.read(&gpu, 100).expect("reads");
        for (i, axis) in (0..50).flat_map(|i| (0..3).map(move |axis| (i, axis))) {
            // Added to the ones that were there, so good to an ulp of 1.
            let gradient = f64::from(found[2 * i + 1][axis]) - 1.0;
            assert!((gradient - d_wanted[i][axis]).abs() < 3e-7, "{i} {axis}");
            let at = |offset: f64| {
                let mut moved = scales.clone();
                moved[i][axis] += offset;
                oracle(&moved).0
            };
            let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((difference - d_wanted[i][axis]).abs() < 1e-7, "{i} {axis}");
        }
        assert!(
            d_wanted.iter().flatten().any(|g| g.abs() > 1e-3),
            "the gradients are not all small"
        );
        assert!(found.iter().step_by(2).all(|row| *row == [1.0; 4]), "rotations are left alone");
    }
}

/// Each of 20 steps rounds a value of about 1 (6e-8) and moves it by at most 0.4 with some 10 roundings:
/// 20 (6e-8 + 0.4 * 6e-7) = 6e-6 at most. Measured on llvmpipe and on SwiftShader: 9.5e-7.
#[test]
fn adam_matches_the_oracle() {
    let gpu = support::gpu();
    let adam = Adam::new(&gpu).expect("compiles");
    let count = 70;
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut row = || -> [f32; 4] { std::array::from_fn(|_| rng.random_range(-1.0..1.0)) };
    let values: Vec<_> = (0..2 * count).map(|_| row()).collect();
    let gradients: Vec<Vec<_>> = (0..20).map(|_| (0..2 * count).map(|_| row()).collect()).collect();
    let zeros = vec![[0.0f32; 4]; 2 * count];
    let rows = |rows: &[[f32; 4]]| Buffer::from_slice(&gpu, "rows", rows).expect("fits");
    let parameters =
        Parameters { values: rows(&values), first: rows(&zeros), second: rows(&zeros), rows: 2 };
    let (gradient, sums) = (rows(&zeros), rows(&zeros));
    let steps = Buffer::<u32>::new(&gpu, "steps", count).expect("fits");
    let corrections = Buffer::new(&gpu, "corrections", count).expect("fits");
    let hits = HitCount { drawn: 1, wanted: 1, ..HitCount::default() };
    let counts = Buffer::from_slice(&gpu, "counts", &[hits]).expect("fits");
    let ranks = Ranks::all(&gpu, &Sort::new(&gpu).expect("compiles"), count).expect("fits");
    let seen = SeenGaussians { ranks: &ranks, sums: (&sums, 2), counts: [&counts; 2], count };
    let moves = ParameterGradients {
        ranks: &ranks,
        rows: (&gradient, 2),
        corrections: &corrections,
        count,
    };
    let rates = [[0.1, 0.2, 0.3, 0.4], [0.01; 4]];
    let row_rates = RowRates { even: rates[0], odd: rates[1], odd_at_most: f32::MAX };
    let is_seen = |step: usize, gaussian: usize| !(step + gaussian).is_multiple_of(3);
    let mut wanted: Vec<_> = values
        .iter()
        .map(|row| row.map(|v| oracle::adam::State { value: v.into(), ..Default::default() }))
        .collect();
    let mut taken = vec![0u32; count];
    for (step, step_gradients) in gradients.iter().enumerate() {
        let weight =
            |row: usize| f32::from(u8::from(row.is_multiple_of(2) && is_seen(step, row / 2)));
        sums.write(
            &gpu,
            0,
            &(0..2 * count).map(|row| [0.0, 0.0, 0.0, weight(row)]).collect::<Vec<_>>(),
        );
        let mut poisoned = step_gradients.clone();
        poisoned[7][1] = f32::NAN;
        gradient.write(&gpu, 0, &poisoned);
        let mut recorder = Recorder::new(&gpu).expect("fits");
        adam.advance(&mut recorder, seen, Youth::NONE, &steps, &corrections);
        adam.update(&mut recorder, &parameters, row_rates, moves);
        recorder.submit();
        for gaussian in (0..count).filter(|gaussian| is_seen(step, *gaussian)) {
            taken[gaussian] += 1;
            for (row, i) in (0..2).flat_map(|r| (0..4).map(move |i| (2 * gaussian + r, i))) {
                let (g, rate) = (step_gradients[row][i], rates[row % 2][i]);
                if (row, i) != (7, 1) {
                    let state = &mut wanted[row][i];
                    *state =
                        oracle::adam::update(*state, g.into(), rate.into(), taken[gaussian] as i32);
                }
            }
        }
    }
    let found = parameters.values.read(&gpu, 2 * count).expect("reads");
    let off = |wanted: f64, found: f32| (wanted - f64::from(found)).abs();
    let pairs = || wanted.iter().flatten().zip(found.iter().flatten());
    let worst = pairs().map(|(w, f)| off(w.value, *f)).fold(0.0, f64::max);
    println!("adam: {worst:.1e}");
    assert!(worst < 6e-6, "{worst:.1e}");
    assert_eq!(found[7][1], values[7][1], "a gradient that is not a number changes nothing");
    assert_eq!(steps.read(&gpu, count).expect("reads"), taken);
    let control = pairs().map(|(w, f)| off(w.value * 1.001, *f)).fold(0.0, f64::max);
    assert!(control > 6e-6, "a per mille must show");
}

#[test]
fn the_logarithms_are_those_of_the_decays() {
    for (beta, logarithm) in [(BETA_FIRST, LOG_BETA_FIRST), (BETA_SECOND, LOG_BETA_SECOND)] {
        assert_eq!(f64::from(beta).ln() as f32, logarithm);
    }
}

#[test]
fn an_overflowed_list_stops_adam() {
    let gpu = support::gpu();
    let adam = Adam::new(&gpu).expect("compiles");
    let rows = |row: [f32; 4]| Buffer::from_slice(&gpu, "rows", &[row, row]).expect("fits");
    let steps = Buffer::<u32>::new(&gpu, "steps", 1).expect("fits");
    let corrections = Buffer::<[f32; 2]>::new(&gpu, "corrections", 1).expect("fits");
    let hits = |drawn, missing| {
        Buffer::from_slice(&gpu, "counts", &[HitCount { drawn, missing, ..HitCount::default() }])
            .expect("fits")
    };
    let ranks = Ranks::all(&gpu, &Sort::new(&gpu).expect("compiles"), 1).expect("fits");
    let (whole, cut, sums) = (hits(5, 0), hits(5, 1), rows([1.0; 4]));
    for (counts, moves) in [([&whole, &cut], 0), ([&cut, &whole], 0), ([&whole, &whole], 1)] {
        let seen = SeenGaussians { ranks: &ranks, sums: (&sums, 2), counts, count: 1 };
        let mut recorder = Recorder::new(&gpu).expect("fits");
        adam.advance(&mut recorder, seen, Youth::NONE, &steps, &corrections);
        recorder.submit();
        assert_eq!(steps.read(&gpu, 1).expect("reads"), [moves]);
        assert_eq!(corrections.read(&gpu, 1).expect("reads")[0][0] > 0.0, moves == 1);
    }
}

#[test]
fn scales_stay_below_their_limit() {
    let gpu = support::gpu();
    let adam = Adam::new(&gpu).expect("compiles");
    let rows = |row: [f32; 4]| Buffer::from_slice(&gpu, "rows", &[row, row]).expect("fits");
    let corrections = Buffer::from_slice(&gpu, "corrections", &[[1.0f32, 1.0]]).expect("fits");
    let ranks = Ranks::all(&gpu, &Sort::new(&gpu).expect("compiles"), 1).expect("fits");
    let gradient = rows([-1.0; 4]);
    // A step from 0 with a rate of 0.1, without bias correction: 0.1 (1 - b1) / sqrt(1 - b2).
    let free = 0.01 / 0.001f32.sqrt();
    for (odd_at_most, scale) in [(0.05, 0.05), (f32::MAX, free)] {
        let (values, first, second) = (rows([0.0; 4]), rows([0.0; 4]), rows([0.0; 4]));
        let parameters = Parameters { values, first, second, rows: 2 };
        let rates = RowRates { even: [0.1; 4], odd: [0.1; 4], odd_at_most };
        let rows = (&gradient, 2);
        let gradients =
            ParameterGradients { ranks: &ranks, rows, corrections: &corrections, count: 1 };
        let mut recorder = Recorder::new(&gpu).expect("fits");
        adam.update(&mut recorder, &parameters, rates, gradients);
        recorder.submit();
        let found = parameters.values.read(&gpu, 2).expect("reads");
        for (found, wanted) in found.iter().zip([[free; 4], [scale, scale, scale, free]]) {
            let off = found.iter().zip(wanted).map(|(found, wanted)| (found - wanted).abs());
            assert!(off.fold(0.0, f32::max) < 1e-5, "{found:?} {wanted:?}");
        }
    }
}
