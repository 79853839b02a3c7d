//! `lexsplat query`: asks a map where something is, prints boxes and objects, writes images.
//! Several texts are handled by [`super::segment`].

use super::segment;
use crate::access::AccessOptions;
use crate::answer::{best_object, metres, shown};
use crate::files::{make_answer_folder, save, save_image};
use crate::waiting::{self, Waiting};
use anyhow::{Context as _, Result, bail};
use lexsplat_client::http::{
    Answer, Bounds, HttpClient, Keyframe, Object, PixelBox, Question, ReadOf, Understood, View,
    project,
};
use lexsplat_evaluate::table::{Column, table};
use std::path::{Path, PathBuf};

/// Ask a map where something is, or label it with several texts
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  lexsplat query 'coffee cup' --map kitchen\n  \
                        lexsplat query 'coffee cup' --map kitchen --frame 120 --out cup\n  \
                        lexsplat query 'chair, dining table, floor' --map kitchen --frame 120\n  \
                        lexsplat query chair --map kitchen --near 1.2,0,2.5 --not stool\n  \
                        lexsplat query 'Where is the red chair next to the window?' --map kitchen\n\n\
                        Colors, sizes and places are decided one by one; the answer says how the text was \
                        understood. Put quotes into the text around a name that is meant word by word: \
                        '\"red wine\"'")]
pub struct Query {
    /// The object to find, in plain words; several texts, separated by spaces or commas, are compared with
    /// each other
    #[arg(required = true, value_name = "TEXT")]
    texts: Vec<String>,
    /// The map
    #[arg(long, value_name = "NAME")]
    map: String,
    /// Ask about the view of this tracked frame instead of the whole map
    #[arg(long, value_name = "SEQUENCE")]
    frame: Option<u64>,
    /// Negative text, instead of the server's own; may be given several times
    #[arg(long = "not", value_name = "WORDS")]
    negatives: Vec<String>,
    /// Relevancy above which something counts, 0 to 1
    #[arg(long, value_name = "SHARE")]
    threshold: Option<f32>,
    /// Objects nearest to this point first, metres
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    near: Option<[f32; 3]>,
    /// Only inside this box: smallest corner, then largest, metres
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = numbers::<6>, allow_hyphen_values = true)]
    within: Option<[f32; 6]>,
    /// Folder for heatmap.png, overlay.png, uncertainty.png, heatmap.npy and points.ply; made if missing
    #[arg(long, value_name = "DIR", default_value = "query-out")]
    out: PathBuf,
    /// The server's HTTP address
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:8080")]
    http: String,
    #[command(flatten)]
    access: AccessOptions,
    #[command(flatten)]
    waiting: Waiting,
    /// Print the server's answer as JSON instead
    #[arg(long)]
    json: bool,
}

/// Distance from which an object is seen best.
const GOOD_DISTANCE_METRES: f64 = 1.8;

/// Runs the command.
pub async fn run(arguments: &Query) -> Result<()> {
    let Query { map, frame, out, http, access, json, .. } = arguments;
    let client = arguments.waiting.client(http, &access.read()?)?;
    let question = arguments.question()?;
    if question.texts.is_some() {
        let asked = segment::Asked { client: &client, map, question: &question, json: *json };
        return segment::run(&asked, out).await;
    }
    let answer = waiting::shown(client.query(map, &question)).await?;
    let Answer { revision, through, settled, converged, .. } = answer;
    waiting::note(&ReadOf { revision, through, settled, converged });
    make_answer_folder(out)?;
    if *json {
        say!("{}", serde_json::to_string_pretty(&answer)?)?;
    } else {
        say_part!("{}", described(&answer))?;
    }
    if let Some(link) = &answer.points {
        save(&out.join("points.ply"), client.points_ply(link).await?)?;
    }
    match (frame, best_object(&answer)) {
        (Some(sequence), _) => pictures(&client, &answer, *sequence, out).await?,
        (None, Some(object)) => {
            let frames = client.frames(map).await?;
            if let Some(view) = best_view(&frames, object.center.map(f64::from)) {
                let view_of = Some(View::of_frame(view.sequence));
                let question = Question { view: view_of, near: None, within: None, ..question };
                let seen = client.query(map, &question).await?;
                pictures(&client, &seen, view.sequence, out).await?;
                note!("overlay.png shows frame {}, which sees the best object", view.sequence);
            }
        }
        (None, None) => {}
    }
    note!("files are in {}", out.display());
    Ok(())
}

impl Query {
    fn question(&self) -> Result<Question> {
        let (text, texts) = match &self.texts()[..] {
            [] => bail!("there is no text to look for"),
            [text] => (Some(text.clone()), None),
            several => (None, Some(several.to_vec())),
        };
        Ok(Question {
            text,
            texts,
            negatives: (!self.negatives.is_empty()).then(|| self.negatives.clone()),
            view: self.frame.map(View::of_frame),
            threshold: self.threshold,
            near: self.near,
            within: self
                .within
                .map(|[x0, y0, z0, x1, y1, z1]| Bounds { min: [x0, y0, z0], max: [x1, y1, z1] }),
            ..Question::default()
        })
    }

    /// Each text once. As on the dashboard, a comma that is not in quotes separates texts.
    fn texts(&self) -> Vec<String> {
        let mut texts = Vec::<String>::new();
        for text in self.texts.iter().flat_map(|words| split_at_commas(words)).map(str::trim) {
            if !text.is_empty() && texts.iter().all(|known| known != text) {
                texts.push(text.to_owned());
            }
        }
        texts
    }
}

/// Parts of a text between commas that are not in quotes.
fn split_at_commas(text: &str) -> impl Iterator<Item = &str> {
    let mut is_quoted = false;
    text.split(move |letter| {
        is_quoted ^= matches!(letter, '"' | '“' | '”');
        letter == ',' && !is_quoted
    })
}

/// `N` numbers, separated by commas.
fn numbers<const N: usize>(text: &str) -> Result<[f32; N], String> {
    let parts: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let parts = parts.ok().and_then(|parts| <[f32; N]>::try_from(parts).ok());
    parts.ok_or_else(|| format!("expected {N} numbers with commas between them, found {text:?}"))
}

/// The keyframe that sees a point best: near the middle of the image and from a good distance.
fn best_view(frames: &[Keyframe], point: [f64; 3]) -> Option<&Keyframe> {
    let cost = |frame: &Keyframe| {
        let [u, v, z] = project(frame, point)?;
        let (width, height) = (f64::from(frame.camera.width), f64::from(frame.camera.height));
        let off = (u / width - 0.5).hypot(v / height - 0.5);
        Some(off + (z / GOOD_DISTANCE_METRES).ln().abs())
    };
    let seen = frames.iter().filter(|frame| frame.has_language);
    let priced = seen.filter_map(|frame| cost(frame).map(|cost| (cost, frame)));
    priced.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, frame)| frame)
}

/// Writes heatmap.png, heatmap.npy, uncertainty.png and overlay.png of a view's answer.
async fn pictures(client: &HttpClient, answer: &Answer, sequence: u64, out: &Path) -> Result<()> {
    let link = answer.heatmap.as_ref().context("the server's answer has no heat map")?;
    let (relevancy, file) = client.heatmap(link).await?;
    save(&out.join("heatmap.npy"), file)?;
    save(&out.join("heatmap.png"), client.heatmap_png(link).await?)?;
    if let Some(link) = &answer.uncertainty {
        save(&out.join("uncertainty.png"), client.heatmap_png(link).await?)?;
    }
    let render = client.render_png(&answer.map, sequence).await?;
    let render = image::load_from_memory(&render).context("the server's picture")?.to_rgb8();
    save_image(&out.join("overlay.png"), &shown(&render, &relevancy, answer))
}

/// An answer as text.
fn described(answer: &Answer) -> String {
    let mut text = format!(
        "{:?} in {}: {}, confidence {:.2}, {:.0} ms\n",
        answer.text,
        answer.map,
        if answer.present { "present" } else { "not present" },
        answer.confidence,
        answer.timing_ms.total
    );
    if let Some(understood) = understood(answer) {
        text += &format!("understood: {understood}\n");
    }
    if let Some(reason) = &answer.reason {
        text += &format!("reason: {reason}\n");
    }
    if let Some(peak) = answer.peak {
        text += &format!("peak {:.2} at pixel ({:.0}, {:.0})\n", peak.score, peak.x, peak.y);
    }
    match answer.boxes.as_deref() {
        Some([]) => text += &format!("no pixel is above {:.2}\n", answer.threshold),
        Some(boxes) => text += &boxes_table(boxes),
        None => {}
    }
    match answer.objects.as_deref() {
        Some([]) => text += &format!("no object is above {:.2}\n", answer.threshold),
        Some(objects) => text += &objects_table(objects),
        None => {}
    }
    text
}

/// How the text was understood, if that is not the text itself.
fn understood(answer: &Answer) -> Option<String> {
    let Understood { object, attributes, relation, others } = &answer.understood;
    let mut parts = vec![format!("object {object:?}")];
    parts.extend(attributes.iter().map(|attribute| format!("{attribute:?}")));
    if let Some(relation) = relation {
        let others: Vec<String> = others.iter().map(|other| format!("{other:?}")).collect();
        parts.push(format!("{relation} {}", others.join(" and ")));
    }
    (*object != answer.text).then(|| parts.join(", "))
}

fn boxes_table(boxes: &[PixelBox]) -> String {
    let columns = ["box", "score", "x px", "y px", "width px", "height px"].map(Column::right);
    let rows: Vec<Vec<String>> = boxes
        .iter()
        .enumerate()
        .map(|(at, b)| {
            let sides = [b.x, b.y, b.width, b.height].map(|side| format!("{side:.0}"));
            [vec![(at + 1).to_string(), format!("{:.3}", b.score)], sides.to_vec()].concat()
        })
        .collect();
    table(&columns, &rows)
}

fn objects_table(objects: &[Object]) -> String {
    let distances = objects.iter().any(|object| object.distance.is_some());
    let mut columns = ["object", "score", "confidence", "centre m", "size m", "points"]
        .map(Column::right)
        .to_vec();
    columns.extend(distances.then_some(Column::right("distance m")));
    let rows: Vec<Vec<String>> = objects
        .iter()
        .enumerate()
        .map(|(at, object)| {
            let mut row = vec![
                (at + 1).to_string(),
                format!("{:.3}", object.score),
                format!("{:.2}", object.confidence),
                metres(object.center),
                metres(object.size),
                object.points.to_string(),
            ];
            row.extend(distances.then(|| format!("{:.2}", object.distance.unwrap_or_default())));
            row
        })
        .collect();
    table(&columns, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn answer(extra: serde_json::Value) -> Answer {
        let mut value = json!({"query_id": "q", "text": "cup", "understood": {"object": "cup"},
            "map": "room", "revision": 3,
            "present": true, "confidence": 0.87, "coverage": 1.0, "threshold": 0.5,
            "timing_ms": {"text": 1.0, "render": 2.0, "decode": 3.0, "score": 4.0, "total": 10.0}});
        let fields = extra.as_object().unwrap().clone();
        value.as_object_mut().unwrap().extend(fields);
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn commas_separate_texts_unless_they_are_in_quotes() {
        let parts = |text| split_at_commas(text).collect::<Vec<_>>();
        assert_eq!(parts("bed, window"), ["bed", " window"]);
        assert_eq!(parts("\"bed, window\", door"), ["\"bed, window\"", " door"]);
        assert_eq!(parts("“1,5 m table”"), ["“1,5 m table”"]);
    }

    #[test]
    fn answers_are_described_with_units() {
        let view = answer(json!({"peak": {"x": 12.0, "y": 7.0, "score": 0.91},
            "boxes": [{"x": 5.0, "y": 4.0, "width": 20.0, "height": 10.0, "score": 0.91}]}));
        let text = described(&view);
        assert!(text.starts_with("\"cup\" in room: present, confidence 0.87, 10 ms\n"), "{text}");
        assert!(text.contains("peak 0.91 at pixel (12, 7)"), "{text}");
        assert!(text.contains("  1  0.910     5     4        20         10\n"), "{text}");
        assert!(!text.contains("object"), "{text}");
        let space = answer(json!({"present": false, "objects": []}));
        let text = described(&space);
        assert!(text.contains("not present") && text.contains("no object is above 0.50"), "{text}");
        assert!(best_object(&space).is_none());
        assert!(!described(&view).contains("understood"), "the text is the name");
        let chosen = answer(json!({"text": "red cup by the bowl", "reason": "no bowl was found",
            "understood": {"object": "cup", "attributes": ["red"], "relation": "next to",
                "others": ["bowl"]}}));
        let text = described(&chosen);
        let understood = "understood: object \"cup\", \"red\", next to \"bowl\"\n";
        assert!(
            text.contains(understood) && text.contains("reason: no bowl was found\n"),
            "{text}"
        );
    }

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        query: Query,
    }

    fn line(arguments: &[&str]) -> Result<Question, clap::Error> {
        use clap::Parser as _;
        let words = [&["query", "--map", "m"], arguments].concat();
        Line::try_parse_from(words).map(|line| line.query.question().unwrap())
    }

    #[test]
    fn texts_places_and_negatives_are_read() {
        let one = line(&["cup", "--near", "-1,2.5,0", "--not", "mug"]).unwrap();
        assert_eq!((one.text.as_deref(), one.near), (Some("cup"), Some([-1.0, 2.5, 0.0])));
        assert_eq!(one.negatives.unwrap(), ["mug"]);
        let several = line(&["cup", "sofa", "--frame", "3"]).unwrap();
        assert!(several.text.is_none() && several.texts.unwrap() == ["cup", "sofa"]);
        for same in [&["bed, window"][..], &["bed", "window"], &[" bed,, window ,bed"]] {
            assert_eq!(line(same).unwrap().texts.unwrap(), ["bed", "window"], "{same:?}");
        }
        assert_eq!(line(&["coffee cup,"]).unwrap().text.as_deref(), Some("coffee cup"));
        let empty =
            <Line as clap::Parser>::try_parse_from(["query", "--map", "m", " , "]).unwrap().query;
        assert!(empty.question().is_err(), "there is nothing to ask");
        let within = line(&["cup", "--within", "0,0,0,1,2,3"]).unwrap().within.unwrap();
        assert_eq!(within.max, [1.0, 2.0, 3.0]);
        for wrong in [&[][..], &["cup", "--near", "1,2"], &["cup", "--within", "0,0,0,1,2,x"]] {
            assert!(line(wrong).is_err(), "{wrong:?}");
        }
    }

    /// A camera at `at` that looks along the world's x with z up.
    fn keyframe(sequence: u64, at: [f64; 3]) -> Keyframe {
        let [x, y, z] = at;
        serde_json::from_value(json!({"sequence": sequence, "has_language": true,
            "timestamp": 0.0, "timestamp_nanos": 0,
            "world_from_camera": [0, 0, 1, x, -1, 0, 0, y, 0, -1, 0, z, 0, 0, 0, 1],
            "camera": {"width": 65, "height": 49, "fx": 50, "fy": 50, "cx": 32, "cy": 24}}))
        .unwrap()
    }

    #[test]
    fn the_best_view_is_central_and_not_too_far() {
        let at = |sequence, x, y| keyframe(sequence, [x, y, 1.0]);
        let point = [2.0, 0.0, 1.0];
        let frames = [at(1, 3.0, 0.0), at(2, -6.0, 0.0), at(3, 0.2, 0.6), at(4, 0.2, 0.1)];
        let best = |frames: &[Keyframe]| best_view(frames, point).map(|frame| frame.sequence);
        assert_eq!(best(&frames), Some(4));
        assert_eq!(best(&frames[..3]), Some(3));
        assert_eq!(best(&frames[..2]), Some(2));
        assert_eq!(best(&frames[..1]), None, "it looks the other way");
        let deaf = Keyframe { has_language: false, ..frames[3].clone() };
        assert_eq!(best(&[deaf]), None);
    }
}
