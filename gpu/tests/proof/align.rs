//! Alignment: known motions are found again, and what cannot be seen is left alone.

use crate::normal_system::on_the_way;
use crate::room::{Bench, Frame, camera, distance, motion, shoot, texture};

use crate::oracle::align as oracle;
use crate::oracle::pyramid as levels;
use lexsplat_gpu::align::{Prior, Robust, align, se3};
use lexsplat_gpu::{AlignSettings, Camera, Estimate, GpuError, NormalSystem, Schedule};
use nalgebra::{Isometry3, Matrix6, Vector6};

#[test]
fn a_known_motion_is_found() {
    let mut bench = Bench::new();
    let huber = AlignSettings::default();
    let cauchy = AlignSettings { geometric_robust: Robust::Cauchy, ..huber };
    let photometric = AlignSettings { geometric_weight: 0.0, ..huber };
    let geometric = AlignSettings { photometric_weight: 0.0, ..huber };
    // Last: the bound, in metres and radians. Measured (llvmpipe), in mm and mrad: 0.05 0.02,
    // 0.04 0.01, 0.02 0.01, 0.33 0.10 (the picture's rounding to 8 bit), 0.05 0.03, 0.06 0.01.
    for (outliers, settings, with_exposure, bound) in [
        (0.0, huber, true, 2e-4),
        (0.0, cauchy, true, 2e-4),
        (0.0, AlignSettings { stride: 4, ..cauchy }, true, 2e-4),
        (0.0, photometric, true, 1e-3),
        (0.0, geometric, false, 2e-4),
        (0.1, cauchy, true, 2e-4),
    ] {
        let (reference, live) = bench.pair((320, 180), 3, outliers);
        let schedule = Schedule { settings, with_exposure, ..Schedule::default() };
        let found =
            bench.aligner.align(&reference, &live, &Estimate::default(), &schedule).expect("sums");
        let (metres, radians) = distance(&found.estimate, &motion());
        let [a, b] = found.estimate.exposure;
        println!(
            "{outliers} {metres:.6} m {radians:.6} rad a {a:.4} b {b:.4}, {} systems, {:.2e}",
            found.evaluations, found.conditioning
        );
        assert!(metres < bound && radians < bound, "{metres} m, {radians} rad");
        assert!(found.conditioning > 1e-3, "{}", found.conditioning);
        // Intensity alone is a flat valley here, and slopes beside outliers are rough.
        assert!(found.converged || settings == photometric || outliers > 0.0);
        assert!(found.overlap() > 0.9 && found.overlap() < 1.0);
        if with_exposure {
            let (low, high) = if outliers > 0.0 { (0.06, 0.11) } else { (0.09, 0.11) };
            assert!((low..high).contains(&a), "{a}");
            // Both exposures agree where the picture's intensities are.
            assert!((a.exp() * 0.4 + b - (0.1f64.exp() * 0.4 + 0.02)).abs() < 0.005, "{a} {b}");
        } else {
            assert_eq!([a, b], [0.0; 2]);
        }
        let inverse = Estimate {
            reference_from_live: motion().reference_from_live.inverse(),
            exposure: motion().exposure,
        };
        let (metres, radians) = distance(&found.estimate, &inverse);
        assert!(metres > 0.05 && radians > 0.06, "the inverse motion is another one");
    }
}

/// A textured wall with boards 6 cm before it, and a floor.
fn boards(camera: &Camera, room_from_camera: &Isometry3<f64>) -> Frame {
    let mut frame = Frame { rgb: Vec::new(), depth: Vec::new() };
    let origin = room_from_camera.translation.vector;
    for at in 0..camera.pixels() {
        let (u, v) = (at % camera.width as usize, at / camera.width as usize);
        let way = room_from_camera.rotation * levels::ray(camera, u as f64, v as f64);
        let on_plane = |axis: usize, place: f64| (place - origin[axis]) / way[axis];
        let board = Some(on_plane(2, 2.44)).filter(|z| {
            let x = origin.x + z * way.x;
            (x / 0.3).rem_euclid(1.0) < 0.5
        });
        let floor = Some(on_plane(1, 0.9)).filter(|z| *z > 0.0);
        let z = board.into_iter().chain(floor).fold(on_plane(2, 2.5), f64::min);
        let grey = texture(&(origin + z * way)) * 255.0;
        frame.rgb.extend([grey.round() as u8; 3]);
        frame.depth.push(z as f32);
    }
    frame
}

#[test]
fn points_hidden_in_the_reference_do_not_pull() {
    let mut bench = Bench::new();
    let camera = camera(320, 180);
    let truth = se3::exp(&Vector6::new(0.3, -0.05, 0.1, 0.02, -0.08, 0.01));
    let reference = bench.pyramid(&camera, &boards(&camera, &Isometry3::identity()), 3);
    let live = bench.pyramid(&camera, &boards(&camera, &truth), 3);
    let start = Estimate { reference_from_live: truth, exposure: [0.0; 2] };
    let mut off = |settings: AlignSettings| {
        let schedule = Schedule { settings, ..Schedule::default() };
        let found = bench.aligner.align(&reference, &live, &start, &schedule).expect("sums");
        distance(&found.estimate, &start)
    };
    let near = off(AlignSettings::default());
    let lenient = off(AlignSettings {
        photometric_threshold: 0.05,
        geometric_threshold: 0.02,
        depth_gate: 0.1,
        normal_gate: -1.0,
        ..AlignSettings::default()
    });
    println!("{near:?}, lenient {lenient:?}");
    // Measured (llvmpipe): 0.011 mm, 0.006 mrad; 3.1 mm.
    assert!(near.0 < 1e-4 && near.1 < 1e-4, "{near:?}");
    assert!(lenient.0 > 1e-3, "a gate along both sides lets the wall behind pull: {lenient:?}");
}

#[test]
fn the_loop_needs_no_device_and_a_wrong_sign_finds_nothing() {
    let camera = camera(96, 72);
    let frame = |pose: &Isometry3<f64>, exposure| {
        let frame = shoot(&camera, pose, exposure);
        levels::finish(&camera, &levels::unpack(&frame.rgb, &frame.depth))
    };
    let reference = frame(&Isometry3::identity(), [0.0; 2]);
    let live = frame(&motion().reference_from_live, motion().exposure);
    let settings = AlignSettings { depth_gate: 0.3, ..AlignSettings::default() };
    let schedule = Schedule { steps: vec![12], ..Schedule::default() };
    let found = |sign: f64| {
        align(&Estimate::default(), &schedule, |level, estimate| {
            assert_eq!(level, 0);
            let mut system = oracle::system((&reference, &live), estimate, &settings);
            system.g *= sign;
            Ok::<_, GpuError>(system)
        })
        .expect("the oracle has no errors")
    };
    let (metres, radians) = distance(&found(1.0).estimate, &motion());
    println!("{metres} {radians}");
    // Measured 0.6 mm, 0.3 mrad.
    assert!(metres < 1e-3 && radians < 1e-3, "{metres} {radians}");
    let wrong = found(-1.0);
    let (metres, radians) = distance(&wrong.estimate, &motion());
    assert!(metres > 0.02 && radians > 0.03 && !wrong.converged, "{metres} {radians}");
}

#[test]
fn a_step_out_of_the_scene_is_not_taken() {
    // Away from the start the cost per residual is lower, and `kept` residuals are left.
    let found = |kept: u32| {
        let schedule = Schedule { steps: vec![1], ..Schedule::default() };
        align(&Estimate::default(), &schedule, |_, estimate| {
            let moved = estimate.reference_from_live.translation.vector.norm() > 0.0;
            let mut system = NormalSystem::default();
            system.h.fill_with_identity();
            system.g[0] = -0.1;
            system.counts.photometric = if moved { kept } else { 1000 };
            system.photometric_cost = f64::from(system.counts.photometric);
            system.photometric_cost *= if moved { 0.5 } else { 1.0 };
            Ok::<_, GpuError>(system)
        })
        .expect("no errors here")
        .estimate
    };
    assert_eq!(found(400), Estimate::default());
    let moved = found(600).reference_from_live.translation.x;
    assert!((moved - 0.1).abs() < 1e-4, "{moved}");
}

/// A robust cost that curves half as much as its system says: each step goes half the way. After two steps
/// that is known.
#[test]
fn steps_that_a_robust_cost_makes_too_short_are_stretched() {
    let wanted = 0.05;
    let found = |curvature: f64, exact: bool| {
        let schedule = Schedule { steps: vec![20], smallest_step: 1e-4, ..Schedule::default() };
        let found = align(&Estimate::default(), &schedule, |_, estimate| {
            let off = estimate.reference_from_live.translation.x - wanted;
            let mut system = NormalSystem::default();
            system.h.fill_with_identity();
            system.h *= 1e6;
            system.g[0] = 1e6 * curvature * off;
            // A floor of noise, without which the cost never stops to fall by a part of itself.
            system.photometric_cost = 0.5e6 * curvature * off * off + if exact { 0.0 } else { 1e6 };
            system.counts.photometric = 1_000_000;
            Ok::<_, GpuError>(system)
        });
        let found = found.expect("no errors here");
        ((found.estimate.reference_from_live.translation.x - wanted).abs(), found.evaluations)
    };
    let (off, evaluations) = found(0.5, true);
    assert!(off < 1e-5 && evaluations <= 4, "{off} {evaluations}");
    let (off, evaluations) = found(1.0, true);
    assert!(off < 1e-5 && evaluations <= 3, "{off} {evaluations}");
    // Negative control: a curvature beyond what steps are stretched for takes more steps.
    let (_, evaluations) = found(0.2, true);
    assert!(evaluations > 6, "{evaluations}");
    // A short step that promises little beside the noise is taken unseen.
    assert!(found(0.5, false).1 < found(0.5, true).1);
}

#[test]
fn a_wrong_pose_shows_in_the_result() {
    let mut bench = Bench::new();
    let (reference, live) = bench.pair((160, 90), 1, 0.0);
    let schedule = Schedule { steps: vec![0], ..Schedule::default() };
    let mut at =
        |part| bench.aligner.align(&reference, &live, &on_the_way(part), &schedule).expect("sums");
    let (right, wrong) = (at(1.0), at(-1.0));
    assert_eq!((right.estimate, right.evaluations), (on_the_way(1.0), 1));
    assert!(right.photometric_inliers() > 0.8 && right.geometric_inliers() > 0.8);
    assert!(wrong.photometric_inliers() < 0.5 && wrong.geometric_inliers() < 0.5);
    assert!(right.system.cost() < 0.1 * wrong.system.cost());
}

#[test]
fn the_information_is_that_of_the_cost() {
    let mut bench = Bench::new();
    let (reference, live) = bench.pair((160, 90), 1, 0.0);
    let levels = (&reference.levels()[0], &live.levels()[0]);
    let settings = AlignSettings { geometric_weight: 0.0, ..AlignSettings::default() };
    let system = bench.aligner.system(levels.0, levels.1, &on_the_way(1.0), &settings);
    let system = system.expect("sums");
    let fixed = system.information(false);
    let free = system.information(true);
    assert_eq!(fixed, system.h.fixed_view::<6, 6>(0, 0).into_owned());
    let inverse = system.h.try_inverse().expect("regular");
    let wanted = inverse.fixed_view::<6, 6>(0, 0).into_owned().try_inverse().expect("regular");
    assert!((free - wanted).norm() < 1e-6 * wanted.norm(), "inverse of the pose's covariance");
    let cost = (fixed - free).norm() / fixed.norm();
    println!("not knowing the exposure costs {cost:.2e}");
    assert!(cost > 1e-4, "{cost}");
    let step = system.solve(0.0, true, None).expect("regular");
    let wanted = -inverse * system.g;
    let found = Vector6::from_fn(|i, _| wanted[i]);
    assert!((step.tau - found).norm() < 1e-6 * found.norm());
    assert!((step.exposure[0] - wanted[6]).abs() < 1e-6 * wanted.norm());
    let damped = system.solve(1.0, true, None).expect("regular");
    assert!(damped.tau.norm() < step.tau.norm());
}

/// A wall without texture: only its distance and two tilts can be seen.
fn blank_wall(camera: &Camera) -> Frame {
    Frame { rgb: vec![100; 3 * camera.pixels()], depth: vec![2.0; camera.pixels()] }
}

#[test]
fn motion_that_cannot_be_observed_is_left_to_the_prior() {
    let mut bench = Bench::new();
    let camera = camera(80, 60);
    let wall = bench.pyramid(&camera, &blank_wall(&camera), 2);
    let tau = Vector6::new(0.01, 0.02, 0.03, 0.002, -0.001, 0.003);
    let off = Estimate { reference_from_live: se3::exp(&tau), exposure: [0.0; 2] };
    let schedule = Schedule {
        settings: AlignSettings { depth_gate: 0.1, ..AlignSettings::default() },
        steps: vec![5, 5],
        with_exposure: false,
        ..Schedule::default()
    };
    let found = bench.aligner.align(&wall, &wall, &off, &schedule).expect("sums");
    assert_eq!(found.estimate, off, "an unseen motion is not guessed");
    assert!(found.conditioning < 1e-7 && !found.converged, "{}", found.conditioning);
    assert!(found.system.counts.geometric > 1000);
    assert_eq!(found.system.solve(1e-4, false, None), None);

    let prior = Prior {
        information: Matrix6::identity() * 1e3,
        reference_from_live: off.reference_from_live,
    };
    let schedule = Schedule { prior: Some(prior), ..schedule };
    let found = bench.aligner.align(&wall, &wall, &off, &schedule).expect("sums");
    let t = found.estimate.reference_from_live.translation.vector;
    println!("{t:?} {}", found.conditioning);
    assert!(t.z.abs() < 1e-3, "the distance is seen: {t}");
    let expected = off.reference_from_live.translation.vector;
    assert!((t.xy() - expected.xy()).norm() < 2e-3, "the rest is not: {t}");
    // A prior that is surer than the data holds the pose.
    let prior = Prior {
        information: Matrix6::identity() * 1e12,
        reference_from_live: off.reference_from_live,
    };
    let schedule = Schedule { prior: Some(prior), ..schedule };
    let found = bench.aligner.align(&wall, &wall, &Estimate::default(), &schedule).expect("sums");
    let (metres, radians) = distance(&found.estimate, &off);
    assert!(metres < 1e-4 && radians < 1e-4, "{metres} {radians}");
}

#[test]
fn bad_input_is_refused_or_counts_nothing() {
    let mut bench = Bench::new();
    let camera = camera(40, 30);
    let good = bench.pyramid(&camera, &shoot(&camera, &Isometry3::identity(), [0.0; 2]), 2);
    let schedule = Schedule { steps: vec![3, 3], ..Schedule::default() };
    for depth in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-40, 1e35] {
        let mut frame = shoot(&camera, &Isometry3::identity(), [0.0; 2]);
        frame.depth.fill(depth);
        let empty = bench.pyramid(&camera, &frame, 2);
        let found =
            bench.aligner.align(&good, &empty, &Estimate::default(), &schedule).expect("sums");
        assert_eq!(
            (found.system.residuals(), found.estimate),
            (0, Estimate::default()),
            "depth {depth}"
        );
        assert_eq!((found.conditioning, found.converged), (0.0, false));
        assert_eq!(found.system.cost(), 0.0);
        let found =
            bench.aligner.align(&empty, &good, &Estimate::default(), &schedule).expect("sums");
        assert_eq!(found.system.counts.geometric, 0, "depth {depth}");
        assert!(found.system.h.iter().all(|v| v.is_finite()));
    }
    // Looking the other way, and from behind the walls.
    for (tau, inside) in [
        (Vector6::new(0.0, 0.0, 0.0, 0.0, 3.0, 0.0), false),
        (Vector6::new(0.0, 0.0, -50.0, 0.0, 0.0, 0.0), false),
        (Vector6::new(0.0, 0.0, 50.0, 0.0, 0.0, 0.0), true),
    ] {
        let away = Estimate { reference_from_live: se3::exp(&tau), exposure: [0.0; 2] };
        let found = bench.aligner.align(&good, &good, &away, &schedule).expect("sums");
        let counts = found.system.counts;
        assert_eq!((counts.live, counts.photometric, counts.geometric), (1200, 0, 0));
        assert_eq!((counts.inside > 0, found.estimate), (inside, away));
        assert_eq!(found.system.solve(1e-4, true, None), None);
    }
    let levels = (&good.levels()[0], &good.levels()[1]);
    let mut refused = |estimate: &Estimate, settings: &AlignSettings| {
        let error = bench.aligner.system(levels.0, levels.1, estimate, settings);
        matches!(error, Err(GpuError::BadValue { .. }))
    };
    let settings = AlignSettings::default();
    assert!(!refused(&Estimate::default(), &settings), "levels of different sizes are fine");
    let mut lost = Estimate::default();
    lost.reference_from_live.translation.x = f64::NAN;
    assert!(refused(&lost, &settings));
    assert!(refused(&Estimate { exposure: [0.0, f64::NAN], ..Estimate::default() }, &settings));
    assert!(refused(&Estimate { exposure: [9.0, 0.0], ..Estimate::default() }, &settings));
    for bad in [
        AlignSettings { stride: 0, ..settings },
        AlignSettings { photometric_weight: -1.0, ..settings },
        AlignSettings { depth_noise: f64::NAN, ..settings },
        AlignSettings { geometric_threshold: 0.0, ..settings },
        AlignSettings { depth_gate: f64::INFINITY, ..settings },
        AlignSettings { normal_gate: f64::NAN, ..settings },
    ] {
        assert!(refused(&Estimate::default(), &bad), "{bad:?}");
    }
    let schedule = Schedule { steps: vec![1; 3], ..Schedule::default() };
    let error = bench.aligner.align(&good, &good, &Estimate::default(), &schedule);
    assert!(matches!(error, Err(GpuError::ShapeMismatch { what: "levels", .. })));
    let mut good = good;
    let error = bench.pyramids.fill(&mut good, &[0; 7], &vec![1.0; 1200]);
    assert!(matches!(error, Err(GpuError::ShapeMismatch { what: "rgb8", .. })));
    assert!(bench.pyramids.allocate(&camera, 9).is_err());
}
