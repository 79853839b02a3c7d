//! Questions as people ask them, about a room whose things are known: twenty ways to ask for a thing have the
//! answers of its bare noun, and colors, sizes and places pick the right ones of a kind.
//!
//! Language is given (labels with the names of classes), so that it is not the networks that are tested.

use lexsplat_server::pipeline::query::{Answer, Outputs, Query, SpatialFilter, View};
use lexsplat_server::pipeline::snapshot::MapSnapshot;
use lexsplat_synthetic::{Camera, Room};
use lexsplat_tests::{Robot, Server, tiny_config};
use nalgebra::Point3;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Frames of a walk that sees the whole room, and which of them are sent.
const WALK: usize = 180;
const EVERY: usize = 5;
/// Of the questions about attributes and relations, at least this share is answered right.
const RIGHT: f64 = 0.8;
/// If only the noun counted, at most this share would be.
const RIGHT_WITHOUT: f64 = 0.2;
/// How far beside a thing's box the centre of what is found may lie.
const MARGIN_METRES: f64 = 0.1;

/// Ways to ask for a thing. N is the noun, S its plural.
const PHRASINGS: [&str; 20] = [
    "N",
    "N!",
    "the N",
    "A N",
    "S",
    "\"N\"",
    "(N)",
    "  N ?",
    "Where is the N?",
    "WHERE ARE THE S",
    "Where's my N?!",
    "Is there a N in here?",
    "Are there any S in this room?",
    "How many S are there?",
    "Please show me the N.",
    "Can you find a N, please?",
    "Find the \"N\"",
    "I'm looking for a N.",
    "Which one is the N?",
    "Where did I leave the N?",
];

/// Things as they are painted: which one, and its color.
type Paint = (&'static str, [u8; 3]);

/// A question, and the names of all things that are meant.
type Expected = (&'static str, &'static [&'static str]);

const PAINTS_7: &[Paint] = &[
    ("chair_1", [190, 40, 35]),
    ("chair_2", [40, 80, 170]),
    ("chair_3", [60, 140, 70]),
    ("chair_4", [225, 225, 220]),
    ("cushion_1", [200, 50, 45]),
    ("cushion_2", [225, 190, 50]),
];

const QUESTIONS_7: &[Expected] = &[
    ("red chair", &["chair_1"]),
    ("Where is the blue chair?", &["chair_2"]),
    ("GREEN CHAIRS", &["chair_3"]),
    ("Is there a white chair?", &["chair_4"]),
    ("chair that is not red", &["chair_2", "chair_3", "chair_4"]),
    ("chairs which aren't blue or green", &["chair_1", "chair_4"]),
    ("purple chair", &[]),
    ("the yellow cushion", &["cushion_2"]),
    ("cushions, but not the yellow ones", &["cushion_1"]),
    ("tallest lamp", &["lamp_3"]),
    ("the largest picture", &["picture_1"]),
    ("tall cabinet", &["cabinet_2"]),
    ("Where is the low cabinet?", &["cabinet_1"]),
    ("lamp on the cabinet", &["lamp_2"]),
    ("lamp that is not on the cabinet", &["lamp_3"]),
    ("lamp next to the sofa", &[]),
    ("cushions on the sofa", &["cushion_1", "cushion_2"]),
    ("picture above the sofa", &["picture_1", "picture_3"]),
    ("picture that is not above the sofa", &["picture_2"]),
    ("cabinet with a television", &["cabinet_1"]),
    ("cabinet without a television", &["cabinet_2"]),
    ("cabinet under the television", &["cabinet_1"]),
    ("ball under the table", &[]),
    ("chair closest to the teddy bear", &["chair_4"]),
    ("the nearest chair to the sofa", &["chair_1"]),
    ("chairs between the sofa and the ball", &["chair_1", "chair_3"]),
    ("cushion nearest to the window", &["cushion_2"]),
    ("red cushion on the table", &[]),
    ("lamp on the tall cabinet", &["lamp_2"]),
    ("picture next to the yellow bed", &[]),
];

const PAINTS_11: &[Paint] = &[
    ("chair_1", [225, 190, 50]),
    ("chair_2", [110, 60, 150]),
    ("chair_3", [35, 35, 35]),
    ("chair_4", [120, 75, 40]),
    ("mug_1", [200, 40, 40]),
    ("mug_2", [45, 90, 170]),
    ("cushion_1", [60, 140, 70]),
    ("cushion_2", [215, 110, 150]),
];

const QUESTIONS_11: &[Expected] = &[
    ("yellow chair", &["chair_1"]),
    ("violet chairs", &["chair_2"]),
    ("Where is the black chair?", &["chair_3"]),
    ("brown chair", &["chair_4"]),
    ("chairs that are not black", &["chair_1", "chair_2", "chair_4"]),
    ("red chair", &[]),
    ("red mug", &["mug_1"]),
    ("mug that isn't red", &["mug_2"]),
    ("green cushion", &["cushion_1"]),
    ("pink cushions", &["cushion_2"]),
    ("yellow cushion", &[]),
    ("cushion on the bed", &["cushion_2"]),
    ("cushion on the sofa", &["cushion_1"]),
    ("cushion that is not on the bed", &["cushion_1"]),
    ("picture above the sofa", &["picture_2"]),
    ("picture that isn't above the sofa", &["picture_1"]),
    ("picture nearest to the door", &["picture_1"]),
    ("chair closest to the sofa", &["chair_1"]),
    ("chair closest to the bed", &["chair_2"]),
    ("Which chair is nearest to the bookcase?", &["chair_3"]),
    ("ball under the table", &[]),
    ("stool next to the bed", &[]),
    ("mug on the bed", &[]),
    ("mug closest to the laptop", &["mug_2"]),
    ("yellow chair next to the trash can", &[]),
    ("picture next to the clock", &[]),
    ("the red mug on the table", &["mug_1"]),
    ("black chair by the sofa", &[]),
    ("cushion farthest from the door", &["cushion_2"]),
    ("teddy bear on the bed", &[]),
];

/// A room whose things are painted, seen from all sides.
fn walk(seed: u64, paints: &[Paint]) -> Robot {
    let room = Room::new(seed);
    let camera = Camera::new(320, 240);
    let poses: Vec<_> = room.path(WALK).into_iter().step_by(EVERY).collect();
    let mut views: Vec<_> = poses.iter().map(|pose| room.render(&camera, pose)).collect();
    for (name, color) in paints {
        let thing = room.instances().iter().find(|one| one.name == *name).expect("it is there");
        paint(&mut views, thing.id, *color);
    }
    Robot { room, camera, poses, views }
}

/// Paints a thing: as bright as it was, relative to its mean, so that its shades stay.
fn paint(views: &mut [lexsplat_synthetic::View], id: u8, color: [u8; 3]) {
    let bright = |rgb: &[u8]| rgb.iter().map(|&part| f64::from(part)).sum::<f64>();
    let (mut sum, mut count) = (0.0, 0.0);
    for view in views.iter() {
        let pixels = view.rgb.chunks_exact(3).zip(&view.instances);
        for (rgb, _) in pixels.filter(|(_, at)| **at == id) {
            (sum, count) = (sum + bright(rgb), count + 1.0);
        }
    }
    for view in views {
        let pixels = view.rgb.chunks_exact_mut(3).zip(&view.instances);
        for (rgb, _) in pixels.filter(|(_, at)| **at == id) {
            let shade = (bright(rgb) * count / sum).clamp(0.3, 1.7);
            for (part, wanted) in rgb.iter_mut().zip(color) {
                *part = (f64::from(wanted) * shade).min(255.0) as u8;
            }
        }
    }
}

fn about(text: &str, view: Option<View>) -> Query {
    Query {
        text: text.into(),
        negatives: Vec::new(),
        outputs: if view.is_some() { Outputs::VIEW } else { Outputs::SPACE },
        view,
        threshold: None,
        smoothing_pixels: None,
        max_objects: 50,
        filter: SpatialFilter::default(),
    }
}

async fn ask(server: &Server, map: &Arc<MapSnapshot>, text: &str) -> Answer {
    let answer = server.engine.query_snapshot(map.clone(), about(text, None)).await;
    answer.unwrap_or_else(|error| panic!("{text:?}: {error}"))
}

/// The things in whose boxes the centres of an answer's objects lie; "?" for one that lies in none of its kind.
fn named(robot: &Robot, answer: &Answer) -> BTreeSet<String> {
    let class = &answer.understood.object;
    let things = || robot.room.instances().iter().filter(|thing| thing.class == class);
    let name = |center: Point3<f32>| {
        let is_in = |thing: &&lexsplat_synthetic::Instance| {
            (0..3).all(|axis| {
                let at = f64::from(center[axis]);
                let (low, high) = (thing.aabb_min[axis], thing.aabb_max[axis]);
                at > low - MARGIN_METRES && at < high + MARGIN_METRES
            })
        };
        things().find(is_in).map_or("?".to_owned(), |thing| thing.name.clone())
    };
    let objects = answer.objects.iter().flatten();
    objects.map(|object| name(object.center)).collect()
}

/// The shares of the questions that are answered right: all that is meant and nothing else; and the same if
/// only the noun counted.
async fn shares(
    server: &Server,
    robot: &Robot,
    map: &Arc<MapSnapshot>,
    questions: &[Expected],
) -> [f64; 2] {
    let mut right = [0, 0];
    for (text, expected) in questions {
        let expected: BTreeSet<String> = expected.iter().map(|&name| name.to_owned()).collect();
        let answer = ask(server, map, text).await;
        let found = named(robot, &answer);
        let noun = ask(server, map, &answer.understood.object).await;
        let all = named(robot, &noun);
        let is_right = found == expected && answer.present != expected.is_empty();
        right[0] += usize::from(is_right);
        right[1] += usize::from(all == expected);
        let verdict = if is_right { "right" } else { "WRONG" };
        println!(
            "{verdict} {text}: {found:?} of {all:?}, {:?} {:?}",
            answer.understood, answer.reason
        );
    }
    right.map(|count| count as f64 / questions.len() as f64)
}

async fn mapped(
    server: &Server,
    name: &str,
    seed: u64,
    paints: &[Paint],
) -> (Robot, Arc<MapSnapshot>) {
    let robot = walk(seed, paints);
    server.send(robot.labelled_messages(name)).await.expect("the stream ends well");
    server.settled(name).await;
    let map = server.engine.map(name).expect("it is there").snapshot().await;
    (robot, map)
}

/// Of the questions with one thing that is meant, those where the heat map of a view peaks on it, and all. The
/// view is the one that shows the thing best.
async fn peaks(
    server: &Server,
    robot: &Robot,
    map: &Arc<MapSnapshot>,
    questions: &[Expected],
) -> [usize; 2] {
    let mut counts = [0, 0];
    for (text, expected) in questions {
        let [expected] = expected else { continue };
        let thing = robot.room.instances().iter().find(|one| one.name == *expected).expect("one");
        let pixels =
            |at: &usize| robot.views[*at].instances.iter().filter(|id| **id == thing.id).count();
        let frame = (0..robot.views.len()).max_by_key(pixels).expect("there are views");
        let query = about(text, Some(View::Frame(frame as u64)));
        let answer = server.engine.query_snapshot(map.clone(), query).await.expect("an answer");
        let peak = answer.peak.expect("a view has a peak");
        let at = peak.y as usize * robot.camera.width as usize + peak.x as usize;
        let is_right = answer.present && robot.views[frame].instances[at] == thing.id;
        counts[0] += usize::from(is_right);
        counts[1] += 1;
        if !is_right {
            println!("WRONG in frame {frame}: {text}, {:?} {:?}", answer.peak, answer.reason);
        }
    }
    counts
}

/// Each way to ask for a thing has the answers of its noun, bit for bit.
async fn same_answers(server: &Server, map: &Arc<MapSnapshot>) {
    let nouns = ["chair", "sofa", "cushion", "bookcase", "picture"];
    let view = || Some(View::Frame(3));
    for noun in nouns {
        let space = ask(server, map, noun).await;
        let seen =
            server.engine.query_snapshot(map.clone(), about(noun, view())).await.expect("one");
        assert!(space.present && !space.objects.as_ref().expect("objects").is_empty(), "{noun}");
        for phrasing in PHRASINGS {
            let text = phrasing.replace('N', noun).replace('S', &format!("{noun}s"));
            let said = ask(server, map, &text).await;
            assert_eq!(format!("{:?}", said.objects), format!("{:?}", space.objects), "{text}");
            assert_eq!(
                (said.confidence, &*said.understood.object),
                (space.confidence, noun),
                "{text}"
            );
            let query = about(&text, view());
            let said = server.engine.query_snapshot(map.clone(), query).await.expect("an answer");
            let heat =
                |answer: &Answer| answer.heatmap.as_ref().expect("a heat map").values.clone();
            assert!(heat(&said) == heat(&seen), "{text}");
        }
        // Negative control: another noun has other answers.
        let other = ask(server, map, "door").await;
        assert_ne!(format!("{:?}", other.objects), format!("{:?}", space.objects));
    }
}

/// What cannot be decided says so: a refusal that names a way out, or a reason.
async fn clear_statements(server: &Server, map: &Arc<MapSnapshot>) {
    for text in ["not a chair", "everything except chairs", "the red one"] {
        let refused = server.engine.query_snapshot(map.clone(), about(text, None)).await;
        let error = refused.expect_err("it is refused").to_string();
        assert!(error.starts_with("text: ") && error.contains("as in"), "{text}: {error}");
    }
    let reply = reqwest::Client::new()
        .post(server.url("/v1/maps/room/query"))
        .json(&serde_json::json!({"text": "not a chair"}))
        .send()
        .await
        .expect("it answers");
    assert_eq!(reply.status(), 400);
    let problem: serde_json::Value = reply.json().await.expect("JSON");
    assert_eq!(problem["field"], "text", "{problem}");
    for (text, reason) in [
        ("chair next to the unicorn", "no unicorn was found"),
        ("chair left of the table", "depends on where one looks from"),
        ("purple chair", "none is purple (mostly"),
    ] {
        let answer = ask(server, map, text).await;
        assert!(!answer.present && answer.objects.expect("a list").is_empty(), "{text}");
        let found = answer.reason.expect("a reason");
        assert!(found.contains(reason), "{text}: {found}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn colors_sizes_and_places_pick_the_things_that_are_meant() {
    let mut config = tiny_config();
    config.mapper.train_width = 160;
    config.mapper.max_gaussians = 60_000;
    config.query.code_columns = 160;
    let server = Server::start(config).await;
    for (name, seed, paints, questions) in
        [("room", 7, PAINTS_7, QUESTIONS_7), ("other", 11, PAINTS_11, QUESTIONS_11)]
    {
        let (robot, map) = mapped(&server, name, seed, paints).await;
        let [right, without] = shares(&server, &robot, &map, questions).await;
        let [peaked, asked] = peaks(&server, &robot, &map, questions).await;
        println!(
            "{name}: of {} questions {right:.2} are right, {without:.2} if only the noun counts; in views {peaked} of {asked}",
            questions.len()
        );
        assert!(right >= RIGHT && without <= RIGHT_WITHOUT, "{name}: {right} {without}");
        assert!(peaked as f64 >= RIGHT * asked as f64, "{name}: {peaked} of {asked}");
        if name == "room" {
            same_answers(&server, &map).await;
            clear_statements(&server, &map).await;
        }
    }
    server.stop().await;
}
