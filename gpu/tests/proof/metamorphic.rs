//! Changes of a scene that must not change the picture, or must change it in a known way. What is
//! the same twice, and what is hidden behind the camera, is in forward.rs and backward.rs.

use crate::support;

use lexsplat_gpu::{Camera, Gaussians, Gpu, HeadGradient, HostGaussians, HostHead, Renderer};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;

const CHANNELS: usize = 6;

fn map(gpu: &Gpu, scene: &HostGaussians) -> Gaussians {
    let mut gaussians = Gaussians::new(gpu, CHANNELS);
    gaussians.append(scene).expect("fits");
    gaussians
}

/// All channels of both pictures and both opacities.
fn pictures(renderer: &mut Renderer, map: &Gaussians, camera: &Camera) -> Vec<f32> {
    let color = renderer.render_color(map, camera).expect("renders");
    let language = renderer.render_language(map, camera).expect("renders");
    [color.rgb, color.depth, color.opacity, language.codes, language.opacity].concat()
}

fn gradients(renderer: &mut Renderer, map: &Gaussians, camera: &Camera) -> [HeadGradient; 2] {
    let ramp = |i: usize| (i % 19) as f32 / 19.0 - 0.4;
    let rows: Vec<[f32; 4]> =
        (0..camera.pixels()).map(|i| std::array::from_fn(|k| ramp(4 * i + k))).collect();
    let codes: Vec<f32> = (0..camera.pixels() * CHANNELS).map(ramp).collect();
    [
        renderer.color_gradients(map, camera, &rows).expect("runs"),
        renderer.language_gradients(map, camera, &codes).expect("runs"),
    ]
}

/// The Gaussians at these places, in this order.
fn chosen(scene: &HostGaussians, index: &[usize]) -> HostGaussians {
    HostGaussians {
        means: index.iter().map(|i| scene.means[*i]).collect(),
        color: chosen_head(&scene.color, index),
        language: chosen_head(&scene.language, index),
    }
}

fn chosen_head(head: &HostHead, index: &[usize]) -> HostHead {
    let channels = head.channels;
    HostHead {
        rotations: index.iter().map(|i| head.rotations[*i]).collect(),
        log_scales: index.iter().map(|i| head.log_scales[*i]).collect(),
        opacity_logits: index.iter().map(|i| head.opacity_logits[*i]).collect(),
        features: index
            .iter()
            .flat_map(|i| &head.features[channels * i..channels * (i + 1)])
            .copied()
            .collect(),
        channels,
    }
}

fn joined(first: &HostGaussians, second: &HostGaussians) -> HostGaussians {
    let head = |a: &HostHead, b: &HostHead| HostHead {
        rotations: [&a.rotations[..], &b.rotations].concat(),
        log_scales: [&a.log_scales[..], &b.log_scales].concat(),
        opacity_logits: [&a.opacity_logits[..], &b.opacity_logits].concat(),
        features: [&a.features[..], &b.features].concat(),
        channels: a.channels,
    };
    HostGaussians {
        means: [&first.means[..], &second.means].concat(),
        color: head(&first.color, &second.color),
        language: head(&first.language, &second.language),
    }
}

#[test]
fn the_order_of_gaussians_does_not_matter() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = support::camera(67, 45);
    let scene = support::scene(51, 300, CHANNELS, 0.1);
    let mut depths: Vec<u32> = scene
        .means
        .iter()
        .map(|mean| (camera.camera_from_world * Point3::from(*mean)).z.to_bits())
        .collect();
    depths.sort_unstable();
    assert!(depths.windows(2).all(|pair| pair[1] - pair[0] > 8), "depths are distinct");
    let mut order: Vec<usize> = (0..300).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(51));
    let (straight, shuffled) = (map(&gpu, &scene), map(&gpu, &chosen(&scene, &order)));
    let wanted = pictures(&mut renderer, &straight, &camera);
    assert!(pictures(&mut renderer, &shuffled, &camera) == wanted, "bit for bit");
    let wanted = gradients(&mut renderer, &straight, &camera);
    let found = gradients(&mut renderer, &shuffled, &camera);
    for (found, wanted) in found.iter().zip(&wanted) {
        assert!(found.head == chosen_head(&wanted.head, &order), "bit for bit");
    }
    let means: Vec<_> = order.iter().map(|i| wanted[0].means[*i]).collect();
    assert!(found[0].means == means, "bit for bit");
    assert!(found[0].head != wanted[0].head, "the order did change");
}

#[test]
fn behind_an_opaque_wall_nothing_is_drawn_or_trained() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = support::camera(67, 45);
    let front = support::scene(52, 50, CHANNELS, 0.05);
    // Three wide sheets across the view, each as opaque as a Gaussian gets.
    let mut wall = support::scene(53, 3, CHANNELS, 1.0);
    for i in 0..3 {
        wall.means[i] = camera.unproject(33.0, 22.0, 4.6 + 0.1 * i as f32).into();
        for head in [&mut wall.color, &mut wall.language] {
            head.log_scales[i] = [4.0; 3];
            head.opacity_logits[i] = 12.0;
        }
    }
    let mut behind = support::scene(54, 80, CHANNELS, 0.3);
    for mean in &mut behind.means {
        let along = camera.camera_from_world.inverse_transform_vector(&Vector3::new(0.0, 0.0, 5.0));
        *mean = (Point3::from(*mean) + along).into();
    }
    let walled = joined(&front, &wall);
    let wanted = pictures(&mut renderer, &map(&gpu, &walled), &camera);
    let wanted_gradients = gradients(&mut renderer, &map(&gpu, &walled), &camera);
    let all = map(&gpu, &joined(&walled, &behind));
    assert!(pictures(&mut renderer, &all, &camera) == wanted, "bit for bit");
    let given = renderer.contributions(&all, &camera).expect("renders");
    assert!(given[53..].iter().all(|given| given.weight == 0.0), "hidden ones give nothing");
    for (found, wanted) in gradients(&mut renderer, &all, &camera).iter().zip(&wanted_gradients) {
        let (shown, hidden): (Vec<_>, Vec<_>) = ((0..53).collect(), (53..133).collect());
        assert!(chosen_head(&found.head, &shown) == wanted.head, "bit for bit");
        let hidden = chosen_head(&found.head, &hidden);
        assert!(hidden.features.iter().chain(&hidden.opacity_logits).all(|g| *g == 0.0));
    }
    let open = map(&gpu, &joined(&front, &behind));
    let bare = pictures(&mut renderer, &map(&gpu, &front), &camera);
    assert!(pictures(&mut renderer, &open, &camera) != bare, "without the wall they show");
}

#[test]
fn gaussians_outside_the_view_change_nothing() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = support::camera(67, 45);
    let scene = support::scene(55, 100, CHANNELS, 0.1);
    let wanted = pictures(&mut renderer, &map(&gpu, &scene), &camera);
    let wanted_gradients = gradients(&mut renderer, &map(&gpu, &scene), &camera);
    for (u, v, depth) in
        [(-400.0, 20.0, 2.0), (30.0, 900.0, 3.0), (30.0, 20.0, -4.0), (9e3, -9e3, 1.5)]
    {
        let mut group = support::scene(56, 70, CHANNELS, 0.05);
        let away = camera.unproject(u, v, depth) - camera.unproject(33.0, 22.0, 2.0);
        for mean in &mut group.means {
            let centred = [0.05 * mean[0], 0.05 * mean[1], 2.0 + 0.05 * mean[2]];
            *mean = (Point3::from(centred) + away).into();
        }
        // First in the list, so that every index of the others moves.
        let both = map(&gpu, &joined(&group, &scene));
        assert!(pictures(&mut renderer, &both, &camera) == wanted, "{u} {v}: bit for bit");
        let index: Vec<usize> = (70..170).collect();
        for (found, wanted) in
            gradients(&mut renderer, &both, &camera).iter().zip(&wanted_gradients)
        {
            assert!(chosen_head(&found.head, &index) == wanted.head, "{u} {v}: bit for bit");
        }
    }
    let mut inside = support::scene(56, 1, CHANNELS, 0.05);
    inside.means[0] = camera.unproject(30.0, 20.0, 1.0).into();
    let both = map(&gpu, &joined(&inside, &scene));
    assert!(pictures(&mut renderer, &both, &camera) != wanted, "one inside does");
}

#[test]
fn without_gaussians_there_is_no_light_and_no_gradient() {
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = support::camera(33, 21);
    let mut gaussians = map(&gpu, &support::scene(57, 10, CHANNELS, 0.2));
    assert!(pictures(&mut renderer, &gaussians, &camera).iter().any(|value| *value != 0.0));
    assert_eq!(gaussians.prune(1.0).expect("fits"), 10, "no opacity is 1");
    assert!(pictures(&mut renderer, &gaussians, &camera).iter().all(|value| *value == 0.0));
    for gradient in gradients(&mut renderer, &gaussians, &camera) {
        assert!(gradient.means.is_empty() && gradient.head.features.is_empty());
    }
    // A map of which nothing is seen has gradients, all of them zero.
    let mut unseen = support::scene(57, 10, CHANNELS, 0.2);
    unseen.means.iter_mut().for_each(|mean| mean[2] = -mean[2]);
    for gradient in gradients(&mut renderer, &map(&gpu, &unseen), &camera) {
        let head = &gradient.head;
        let flat = [head.rotations.concat(), head.log_scales.concat(), gradient.means.concat()];
        let all = flat.iter().flatten().chain(&head.opacity_logits).chain(&head.features);
        assert!(head.features.len() == 10 * head.channels && all.clone().all(|g| *g == 0.0));
    }
}

/// Moving the world and the camera together changes nothing but the rounding.
#[test]
fn only_the_pose_between_camera_and_world_counts() {
    /// Measured on llvmpipe: 3.9e-6.
    const TOLERANCE: f32 = 2e-5;
    let gpu = support::gpu();
    let mut renderer = Renderer::new(&gpu, CHANNELS).expect("compiles");
    let camera = support::camera(67, 45);
    let scene = support::scene(58, 150, CHANNELS, 0.1);
    let new_from_old = Isometry3::from_parts(
        Translation3::new(0.7, -1.1, 0.4),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.5, -1.0, 0.8)),
    );
    let mut moved = scene.clone();
    for mean in &mut moved.means {
        *mean = (new_from_old * Point3::from(*mean)).into();
    }
    for head in [&mut moved.color, &mut moved.language] {
        for q in &mut head.rotations {
            let turned =
                new_from_old.rotation.quaternion() * Quaternion::new(q[0], q[1], q[2], q[3]);
            *q = [turned.w, turned.i, turned.j, turned.k];
        }
    }
    let moved_camera = Camera {
        camera_from_world: camera.camera_from_world * new_from_old.inverse(),
        ..camera.clone()
    };
    let wanted = pictures(&mut renderer, &map(&gpu, &scene), &camera);
    let moved = map(&gpu, &moved);
    let apart =
        |found: Vec<f32>| found.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let error = apart(pictures(&mut renderer, &moved, &moved_camera));
    println!("moved: {error:.1e}");
    assert!(error < TOLERANCE, "{error:.1e}");
    let control = apart(pictures(&mut renderer, &moved, &camera));
    assert!(control > 0.1, "another pose must show: {control:.1e}");
}
