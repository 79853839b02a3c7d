//! Relations of boxes, and the choice among objects that are made of colored Gaussians.

use super::choose::{Candidates, Choice, Surroundings, choose};
use super::nearness::{gap, is_near};
use super::relation::{holds, is_between};
use super::shape::{Shape, level};
use super::sight::Sight;
use crate::pipeline::query::answer::{Object, ScoredPoint};
use crate::pipeline::query::question::{RelationKind, Wanted, wanted};
use crate::pipeline::query::space::{FoundObject, RelevantGaussian};
use lexsplat_gpu::{Camera, HostGaussians};
use nalgebra::{Isometry3, Point3, UnitQuaternion, UnitVector3, Vector3};

/// Points 4 cm apart on the sides of a box, given by two corners.
fn box_points(low: [f32; 3], high: [f32; 3]) -> Vec<Point3<f32>> {
    let steps: Vec<usize> =
        (0..3).map(|axis| ((high[axis] - low[axis]) / 0.04).ceil() as usize).collect();
    let mut points = Vec::new();
    for i in 0..=steps[0] {
        for j in 0..=steps[1] {
            for k in 0..=steps[2] {
                let at = [i, j, k];
                if (0..3).any(|axis| at[axis] == 0 || at[axis] == steps[axis]) {
                    let along = |axis: usize| {
                        let share = at[axis] as f32 / steps[axis].max(1) as f32;
                        low[axis] + share * (high[axis] - low[axis])
                    };
                    points.push(Point3::new(along(0), along(1), along(2)));
                }
            }
        }
    }
    points
}

fn shape(low: [f32; 3], high: [f32; 3]) -> Shape {
    Shape::new(&box_points(low, high), &UnitQuaternion::identity())
}

/// The top of a table.
const TABLE: ([f32; 3], [f32; 3]) = ([0.0, 0.0, 0.7], [1.4, 1.0, 0.74]);
const CUP: ([f32; 3], [f32; 3]) = ([0.6, 0.4, 0.74], [0.7, 0.5, 0.85]);
const WALL: ([f32; 3], [f32; 3]) = ([-1.0, 2.0, 0.0], [3.0, 2.05, 2.5]);
const PICTURE: ([f32; 3], [f32; 3]) = ([0.2, 1.95, 1.4], [0.8, 2.0, 1.9]);
const CHAIR: ([f32; 3], [f32; 3]) = ([0.3, 1.55, 0.0], [0.75, 1.97, 0.9]);
const BALL: ([f32; 3], [f32; 3]) = ([0.5, 0.3, 0.0], [0.7, 0.5, 0.2]);
const FAR: ([f32; 3], [f32; 3]) = ([5.0, 5.0, 0.0], [5.5, 5.5, 0.5]);

#[test]
fn relations_hold_where_they_should_and_nowhere_else() {
    use RelationKind::{Above, In, Near, On, Under, With};
    let [table, cup, wall, picture, chair, ball, far] =
        [TABLE, CUP, WALL, PICTURE, CHAIR, BALL, FAR].map(|(low, high)| shape(low, high));
    let bowl = shape([0.5, 0.3, 0.74], [0.8, 0.6, 0.86]);
    for (kind, a, b) in [
        (On, &cup, &table),
        (With, &table, &cup),
        (Above, &cup, &table),
        (Under, &table, &cup),
        (On, &picture, &wall),
        (Above, &picture, &chair),
        (Under, &ball, &table),
        (Above, &table, &ball),
        (Under, &chair, &picture),
        (In, &cup, &bowl),
        (With, &bowl, &cup),
        (Near, &chair, &wall),
        (Near, &cup, &table),
        (Near, &chair, &table),
    ] {
        assert!(holds(kind, a, b), "{kind:?} {:?} {:?}", a.center(), b.center());
    }
    for (kind, a, b) in [
        (On, &table, &cup),
        (On, &chair, &wall),
        (On, &ball, &table),
        (On, &cup, &far),
        (With, &cup, &table),
        (Above, &picture, &table),
        (Above, &ball, &table),
        (Under, &cup, &table),
        (Under, &chair, &table),
        (In, &bowl, &cup),
        (In, &chair, &table),
        (Near, &ball, &far),
        (Near, &cup, &picture),
    ] {
        assert!(!holds(kind, a, b), "{kind:?} {:?} {:?}", a.center(), b.center());
    }
    assert!((gap(&chair, &table) - 0.55).abs() < 0.06, "{}", gap(&chair, &table));
    assert!(is_near(&chair, &table) && is_near(&table, &chair));
    assert!(is_between(&chair, &table, &wall) && !is_between(&table, &chair, &wall));
}

#[test]
fn up_decides_what_is_above() {
    // The world's y points down, as in the coordinates of a first camera.
    let up = UnitVector3::new_normalize(Vector3::new(0.0, -1.0, 0.0));
    let turn = level(&up);
    assert!((turn * Vector3::new(0.0, -1.0, 0.0) - Vector3::z()).norm() < 1e-6);
    let world = |(low, high): ([f32; 3], [f32; 3])| -> Shape {
        let points: Vec<_> =
            box_points(low, high).iter().map(|point| turn.inverse() * point).collect();
        Shape::new(&points, &turn)
    };
    let (cup, table) = (world(CUP), world(TABLE));
    assert!(holds(RelationKind::Above, &cup, &table));
    // Negative control: with the world's z as up, it is not.
    let level = UnitQuaternion::identity();
    let [cup, table] = [cup, table].map(|shape| {
        let points: Vec<_> = shape.points.iter().map(|point| turn.inverse() * point).collect();
        Shape::new(&points, &level)
    });
    assert!(!holds(RelationKind::Above, &cup, &table));
    assert!(
        (super::shape::level(&-UnitVector3::new_normalize(Vector3::z())) * Vector3::z()).z < 0.0
    );
}

/// A camera that looks along y, from y = -3.
fn camera() -> Camera {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f32::consts::FRAC_PI_2);
    let world_from_camera = Isometry3::from_parts(Vector3::new(0.7, -3.0, 1.0).into(), turn);
    Camera {
        width: 64,
        height: 48,
        fx: 50.0,
        fy: 50.0,
        cx: 31.5,
        cy: 23.5,
        camera_from_world: world_from_camera.inverse(),
    }
}

#[test]
fn sides_are_those_of_the_view() {
    use RelationKind::{Behind, InFrontOf, LeftOf, RightOf};
    let level = UnitQuaternion::identity();
    let sight = |(low, high)| Sight::new(&shape(low, high), &camera(), &level);
    let [table, chair, behind] =
        [sight(TABLE), sight(CHAIR), sight(([0.0, -5.0, 0.0], [0.4, -4.5, 0.5]))];
    assert!(behind.is_none(), "behind the camera");
    let (table, chair) = (table.expect("it is seen"), chair.expect("it is seen"));
    let left = sight(([-1.2, 0.0, 0.0], [-0.8, 0.4, 0.5])).expect("it is seen");
    assert!(left.holds(LeftOf, &table) && table.holds(RightOf, &left));
    assert!(!left.holds(RightOf, &table) && !left.holds(InFrontOf, &table));
    assert!(table.holds(InFrontOf, &chair) && chair.holds(Behind, &table));
    assert!(!table.holds(Behind, &chair));
}

/// Low and high corner.
type Corners = ([f32; 3], [f32; 3]);

/// A map of boxes in their colors, and the objects.
struct Boxes {
    map: HostGaussians,
    objects: Vec<FoundObject>,
}

impl Boxes {
    fn new(boxes: &[(Corners, [f32; 3])]) -> Self {
        let (mut map, mut objects) = (HostGaussians::default(), Vec::new());
        for ((low, high), color) in boxes {
            let mut members = Vec::new();
            for position in box_points(*low, *high) {
                let row = map.means.len() as u32;
                map.means.push(position.into());
                for head in [&mut map.color, &mut map.language] {
                    head.rotations.push([1.0, 0.0, 0.0, 0.0]);
                    head.log_scales.push([0.015_f32.ln(); 3]);
                    head.opacity_logits.push(3.0);
                    head.features.extend_from_slice(color);
                    head.channels = 3;
                }
                let point = ScoredPoint { position, score: 0.9 };
                members.push(RelevantGaussian {
                    row,
                    point,
                    opacity: 0.95,
                    spread: 0.2,
                    radius: 0.02,
                });
            }
            let center = Point3::origin();
            let object = Object {
                confidence: 0.9,
                score: 0.9,
                center,
                size: Vector3::zeros(),
                rotation: UnitQuaternion::identity(),
                aabb_min: center,
                aabb_max: center,
                points: members.len(),
                distance: None,
            };
            objects.push(FoundObject { object, members });
        }
        Self { map, objects }
    }

    /// What is chosen of the first boxes; the others are of the other kind.
    fn choose(self, text: &str, first: usize, camera: Option<&Camera>) -> Choice {
        let wanted = wanted(text).expect("it is understood");
        let Self { map, mut objects } = self;
        let others = objects.split_off(first);
        let relation = wanted.relation.as_ref();
        let other = relation.map(|relation| &relation.others[0]);
        let other = other.map(|wanted| Candidates {
            wanted,
            is_present: !others.is_empty(),
            objects: others,
            others: Vec::new(),
        });
        let others = other.into_iter().collect();
        let all = Candidates { wanted: &wanted, objects, is_present: true, others };
        let level_from_world = Some(UnitQuaternion::identity());
        choose(&all, &Surroundings { gaussians: &map, level_from_world, camera })
    }
}

/// Three chairs, red, blue and white, at x = 0, 2 and 4; and a door at x = 5.
fn chairs(text: &str, camera: Option<&Camera>) -> Choice {
    let at = |x: f32, high: f32| ([x, 0.0, 0.0], [x + 0.4, 0.4, high]);
    let boxes = [
        (at(0.0, 0.9), [0.75, 0.15, 0.15]),
        (at(2.0, 0.9), [0.15, 0.3, 0.7]),
        (at(4.0, 1.3), [0.9, 0.9, 0.88]),
        (([5.0, 0.0, 0.0], [5.1, 0.9, 2.0]), [0.4, 0.3, 0.2]),
    ];
    Boxes::new(&boxes).choose(text, 3, camera)
}

#[test]
fn attributes_and_relations_choose() {
    for (text, expected) in [
        ("red chair", &[0][..]),
        ("chair that is not red", &[1, 2]),
        ("chair that is not red or white", &[1]),
        ("tall chair", &[2]),
        ("tallest chair", &[2]),
        ("chair that is not the tallest", &[0, 1]),
        ("small chairs", &[0, 1]),
        ("chair nearest to the door", &[2]),
        ("chair farthest from the door", &[0]),
        ("chair next to the door", &[2]),
        ("chair that is not next to the door", &[0, 1]),
        ("blue chair not near the door", &[1]),
        ("light chair", &[2]),
        ("dark blue chair", &[1]),
    ] {
        assert_eq!(chairs(text, None), Choice { kept: expected.to_vec(), reason: None }, "{text}");
    }
    let seen = chairs("chair left of the door", Some(&camera()));
    assert_eq!(seen.kept, [0, 1, 2]);
}

#[test]
fn where_nothing_is_chosen_there_is_a_reason() {
    for (text, reason) in [
        (
            "green chair",
            "3 things called \"chair\" were found, and none is green (mostly blue, red, white)",
        ),
        ("red chair next to the door", "one chair was found, and none is next to door"),
        ("chair on the door", "3 things called \"chair\" were found, and none is on door"),
        ("chair next to the green door", "one door was found, and none is green (mostly brown)"),
        ("chair left of the door", "\"left of\" depends on where one looks from: ask about a view"),
    ] {
        let chosen = chairs(text, None);
        assert_eq!((chosen.reason.as_deref(), chosen.kept.len()), (Some(reason), 0), "{text}");
    }
    let alone = [(([0.0; 3], [0.4, 0.4, 0.9]), [0.7, 0.1, 0.1])];
    let chosen = Boxes::new(&alone).choose("chair next to the door", 1, None);
    assert_eq!(chosen.reason.as_deref(), Some("no door was found"));
    let chosen = Boxes::new(&alone).choose("chair that is not red", 1, None);
    assert_eq!(chosen.reason.as_deref(), Some("one chair was found, and it is red"));
    let chosen = Boxes::new(&alone).choose("chair that is not the largest", 1, None);
    assert_eq!(chosen.reason.as_deref(), Some("there is only one chair"));
    let chosen = Boxes::new(&[]).choose("red chair", 0, None);
    assert_eq!(chosen.reason.as_deref(), Some("no chair was found"));
}

#[test]
fn what_is_not_there_excludes_nothing() {
    let alone = [(([0.0; 3], [0.4, 0.4, 0.9]), [0.7, 0.1, 0.1])];
    for text in ["chair not next to the door", "chair that is not on the green table"] {
        let chosen = Boxes::new(&alone).choose(text, 1, None);
        assert_eq!(chosen, Choice { kept: vec![0], reason: None }, "{text}");
    }
    // Negative control: with a door beside it, the chair is excluded.
    let both = [alone[0], (([0.5, 0.0, 0.0], [0.6, 0.9, 2.0]), [0.4, 0.3, 0.2])];
    assert!(Boxes::new(&both).choose("chair not next to the door", 1, None).kept.is_empty());
    // What cannot be decided is not absent.
    let nested = "chair not next to the door left of the table";
    assert_eq!(Boxes::new(&alone).choose(nested, 1, None).kept, [0], "there is no door at all");
    let undecided = Boxes::new(&both).choose(nested, 1, None);
    assert!(undecided.kept.is_empty(), "{undecided:?}");
    assert!(undecided.reason.is_some_and(|why| why.contains("depends on where one looks from")));
}

#[test]
fn an_object_is_not_related_to_itself() {
    let both = [
        (([0.0; 3], [0.4, 0.4, 0.9]), [0.7, 0.1, 0.1]),
        (([0.0; 3], [0.4, 0.4, 0.9]), [0.7, 0.1, 0.1]),
    ];
    let mut boxes = Boxes::new(&both);
    // The other kind is the same Gaussians: a chair that also looks like a stool.
    boxes.objects[1].members = boxes.objects[0].members.clone();
    assert!(boxes.choose("chair next to the stool", 1, None).kept.is_empty());
    // Negative control: with Gaussians of its own it is another thing.
    assert_eq!(Boxes::new(&both).choose("chair next to the stool", 1, None).kept, [0]);
    assert!(Wanted::plain("chair").is_plain());
}
