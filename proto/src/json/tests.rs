//! The exact JSON of the HTTP interface: names, order and absent fields.

use super::*;

/// Asserts that `value` becomes `json`, and `json` the same value.
fn assert_json<T>(value: &T, json: &str)
where
    T: serde::Serialize + serde::de::DeserializeOwned + PartialEq + std::fmt::Debug,
{
    assert_eq!(serde_json::to_string(value).unwrap(), json);
    assert_eq!(serde_json::from_str::<T>(json).unwrap(), *value);
}

const TIMING: Timing = Timing { text: 1.0, render: 2.0, decode: 3.0, score: 4.0, total: 10.5 };
const TIMING_JSON: &str = r#"{"text":1.0,"render":2.0,"decode":3.0,"score":4.0,"total":10.5}"#;
const CAMERA: Camera = Camera { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5 };
const CAMERA_JSON: &str = r#"{"width":64,"height":48,"fx":60.0,"fy":60.0,"cx":31.5,"cy":23.5}"#;

fn answer() -> Answer {
    Answer {
        query_id: "q".into(),
        text: "cup".into(),
        understood: Understood { object: "cup".into(), ..Understood::default() },
        map: "room".into(),
        revision: 3,
        through: Some(5),
        settled: true,
        converged: false,
        present: true,
        reason: None,
        confidence: 0.75,
        coverage: 1.0,
        threshold: 0.5,
        heatmap: None,
        uncertainty: None,
        mask: None,
        boxes: None,
        peak: None,
        points: None,
        objects: None,
        timing_ms: TIMING,
    }
}

const ANSWER_JSON: &str = concat!(
    r#"{"query_id":"q","text":"cup","understood":{"object":"cup"},"map":"room","revision":3,"#,
    r#""through":5,"settled":true,"converged":false,"present":true,"confidence":0.75,"coverage":1.0,"threshold":0.5"#
);

#[test]
fn answers_about_a_view() {
    let (width, height, url) = (64, 48, "/h".to_owned());
    let view = Answer {
        heatmap: Some(HeatmapLink { width, height, min: 0.25, max: 0.5, url }),
        uncertainty: Some(HeatmapLink { width, height, min: 0.0, max: 0.5, url: "/u".into() }),
        mask: Some(Rle { size: [48, 64], counts: vec![1, 2] }),
        boxes: Some(vec![PixelBox { x: 1.0, y: 2.0, width: 3.0, height: 4.0, score: 0.5 }]),
        peak: Some(Peak { x: 1.0, y: 2.0, score: 0.5 }),
        ..answer()
    };
    let json = format!(
        "{ANSWER_JSON},{}{TIMING_JSON}}}",
        concat!(
            r#""heatmap":{"width":64,"height":48,"min":0.25,"max":0.5,"url":"/h"},"#,
            r#""uncertainty":{"width":64,"height":48,"min":0.0,"max":0.5,"url":"/u"},"#,
            r#""mask":{"size":[48,64],"counts":[1,2]},"#,
            r#""boxes":[{"x":1.0,"y":2.0,"width":3.0,"height":4.0,"score":0.5}],"#,
            r#""peak":{"x":1.0,"y":2.0,"score":0.5},"timing_ms":"#
        )
    );
    assert_json(&view, &json);
    assert_eq!(serde_json::to_string(&Reply::Answer(view)).unwrap(), json);
}

#[test]
fn what_is_understood() {
    let understood = Understood {
        object: "cup".into(),
        attributes: vec!["red".into(), "not big".into()],
        relation: Some("next to".into()),
        others: vec!["bowl".into()],
    };
    let json =
        r#"{"object":"cup","attributes":["red","not big"],"relation":"next to","others":["bowl"]}"#;
    assert_json(&understood, json);
    let nothing = Answer { reason: Some("no bowl was found".into()), understood, ..answer() };
    let json = serde_json::to_string(&nothing).unwrap();
    assert!(json.contains(r#""reason":"no bowl was found","confidence""#), "{json}");
    assert_eq!(serde_json::from_str::<Answer>(&json).unwrap(), nothing);
}

#[test]
fn answers_in_3d() {
    let object = Object {
        score: 0.5,
        confidence: 0.75,
        center: [1.0, 2.0, 3.0],
        size: [1.0; 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
        aabb_min: [0.0; 3],
        aabb_max: [2.0; 3],
        points: 9,
        distance: None,
    };
    let near = Object { distance: Some(0.5), ..object.clone() };
    let points = Some(PointsLink { count: 9, url: "/p".into() });
    let space = Answer { points, objects: Some(vec![object, near]), ..answer() };
    let object = concat!(
        r#"{"score":0.5,"confidence":0.75,"center_metres":[1.0,2.0,3.0],"size_metres":[1.0,1.0,1.0],"rotation":[1.0,0.0,0.0,0.0],"#,
        r#""aabb_min_metres":[0.0,0.0,0.0],"aabb_max_metres":[2.0,2.0,2.0],"points":9"#
    );
    let json = format!(
        r#"{ANSWER_JSON},"points":{{"count":9,"url":"/p"}},"objects":[{object}}},{object},"distance_metres":0.5}}],"timing_ms":{TIMING_JSON}}}"#
    );
    assert_json(&space, &json);
}

#[test]
fn segmentations() {
    let entry = LegendEntry { label: 1, text: "cup".into(), color: "#e6194b".into(), share: 0.5 };
    let found = Segmentation {
        query_id: "q".into(),
        texts: vec!["cup".into(), "sofa".into()],
        map: "room".into(),
        revision: 3,
        through: Some(5),
        settled: true,
        converged: true,
        coverage: 1.0,
        threshold: 0.5,
        legend: vec![entry],
        labels: Some(LabelsLink { width: 64, height: 48, url: "/l".into() }),
        points: None,
        timing_ms: TIMING,
    };
    let json = format!(
        "{}{TIMING_JSON}}}",
        concat!(
            r#"{"query_id":"q","texts":["cup","sofa"],"map":"room","revision":3,"through":5,"#,
            r#""settled":true,"converged":true,"coverage":1.0,"#,
            r##""threshold":0.5,"legend":[{"label":1,"text":"cup","color":"#e6194b","share":0.5}],"##,
            r#""labels":{"width":64,"height":48,"url":"/l"},"timing_ms":"#
        )
    );
    assert_json(&found, &json);
}

#[test]
fn maps_and_keyframes() {
    let status = Status {
        name: "room".into(),
        state: MapState::Ready,
        loading: None,
        revision: 1,
        frames_received: 2,
        frames_tracked: 3,
        frames_lost: 4,
        frames_dropped: 5,
        frames_refused: 6,
        keyframes: 7,
        gaussians: 8,
        gpu_bytes: 9,
        keyframe_bytes: 10,
        tracking_state: "tracking".into(),
        olae_version: 11,
        queue_depth: 12,
        queue_capacity: 13,
        settled: true,
        refinement: "converged".into(),
        failure: None,
        recording_damage: None,
        up: None,
        input_warnings: Vec::new(),
    };
    let json = concat!(
        r#"{"name":"room","state":"ready","revision":1,"frames_received":2,"frames_tracked":3,"#,
        r#""frames_lost":4,"#,
        r#""frames_dropped":5,"frames_refused":6,"keyframes":7,"gaussians":8,"gpu_bytes":9,"#,
        r#""keyframe_bytes":10,"tracking_state":"tracking","olae_version":11,"queue_depth":12,"#,
        r#""queue_capacity":13,"settled":true,"refinement":"converged""#
    );
    let maps = Maps { maps: vec![status.clone()], next: None };
    assert_json(&maps, &format!(r#"{{"maps":[{json}}}]}}"#));
    let maps = Maps { maps: Vec::new(), next: Some("room".into()) };
    assert_json(&maps, r#"{"maps":[],"next":"room"}"#);
    let failed = Status { failure: Some("full".into()), ..status };
    assert_json(&failed, &format!(r#"{json},"failure":"full"}}"#));

    let keyframe = Keyframe {
        sequence: 7,
        timestamp: 1.5,
        timestamp_nanos: 1_500_000_000,
        world_from_camera: [1.0; 16],
        camera: CAMERA,
        has_language: true,
    };
    let frames = Frames { map: "room".into(), revision: 3, frames: vec![keyframe], next: None };
    let pose = ["1.0"; 16].join(",");
    let json = format!(
        r#"{{"map":"room","revision":3,"frames":[{{"sequence":7,"timestamp":1.5,"timestamp_nanos":1500000000,"world_from_camera":[{pose}],"camera":{CAMERA_JSON},"has_language":true}}]}}"#
    );
    assert_json(&frames, &json);
}

#[test]
fn events() {
    let lost = FrameEvent {
        sequence: 7,
        tracking_state: "lost".into(),
        world_from_camera: None,
        keyframe: false,
        revision: 3,
    };
    let json = r#"{"sequence":7,"tracking_state":"lost","keyframe":false,"revision":3}"#;
    assert_json(&lost, json);
    let revision = RevisionEvent { revision: 3, gaussians: 8, keyframes: 2 };
    assert_json(&revision, r#"{"revision":3,"gaussians":8,"keyframes":2}"#);
    let refinement = RefinementEvent { refinement: "refining".into() };
    assert_json(&refinement, r#"{"refinement":"refining"}"#);
    assert_json(&MissedEvent { first: 4, last: 7 }, r#"{"first":4,"last":7}"#);
}

#[test]
fn health_and_problems() {
    let health = Health {
        status: "ready".into(),
        adapter: "a".into(),
        bundle: "tiny".into(),
        version: "1".into(),
        warnings: Vec::new(),
        loading: Vec::new(),
    };
    let json = r#"{"status":"ready","adapter":"a","bundle":"tiny","version":"1""#;
    assert_json(&health, &format!("{json}}}"));
    let progress = LoadProgress { frames_done: 2, frames_total: 5 };
    let loading = vec![MapLoading { map: "room".into(), progress }];
    let loaded = r#""loading":[{"map":"room","frames_done":2,"frames_total":5}]"#;
    assert_json(&Health { loading, ..health }, &format!("{json},{loaded}}}"));
    let problem = Problem {
        kind: "urn:x".into(),
        title: "Bad Request".into(),
        status: 400,
        detail: "d".into(),
        field: Some("text".into()),
        progress: None,
    };
    let json = r#"{"type":"urn:x","title":"Bad Request","status":400,"detail":"d","field":"text"}"#;
    assert_json(&problem, json);
}

#[test]
fn requests() {
    let question = Question {
        texts: Some(vec!["a".into(), "b".into()]),
        near: Some([1.0, 2.0, 3.0]),
        within: Some(Bounds { min: [0.0; 3], max: [1.0; 3] }),
        ..Question::default()
    };
    let json = concat!(
        r#"{"texts":["a","b"],"near_metres":[1.0,2.0,3.0],"#,
        r#""within":{"min_metres":[0.0,0.0,0.0],"max_metres":[1.0,1.0,1.0]}}"#
    );
    assert_json(&question, json);
    assert_json(&Question::in_frame("cup", 7), r#"{"text":"cup","view":{"frame":7}}"#);
    // null is the same as absent.
    let question: Question = serde_json::from_str(r#"{"text":"cup","texts":null}"#).unwrap();
    assert_eq!(question, Question::in_space("cup"));
    for unknown in [r#"{"txt":"cup"}"#, r#"{"view":{"fram":1}}"#] {
        assert!(serde_json::from_str::<Question>(unknown).is_err(), "{unknown}");
    }
}
