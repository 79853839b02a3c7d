//! Reads the logs of a fleet and finds maps that had two owners at a time.
//!
//! Workers log what they changed in a map's entry, with its revision: who took the map, and each checkpoint.
//! Gateways log each acknowledgement with the token of its worker. An owner that does something after a newer
//! one took the map is a fault, and so is an acknowledgement of an owner before.

use serde_json::Value;
use std::collections::BTreeMap;

/// What an owner did with a map's entry, by revision.
#[derive(Debug, Default)]
pub struct Findings {
    /// Maps that were taken.
    pub taken: usize,
    /// Checkpoints that were written.
    pub checkpoints: usize,
    /// Acknowledgements that gateways passed on.
    pub acks: usize,
    /// Acknowledgements that gateways dropped, because their worker had lost the map.
    pub dropped: usize,
    /// What must not be, in words.
    pub faults: Vec<String>,
}

/// Reads the logs of all workers and gateways: JSON, one object a line.
pub fn read(logs: &[String]) -> Findings {
    let mut findings = Findings::default();
    let mut changes: BTreeMap<String, Vec<(u64, u64, String)>> = BTreeMap::new();
    for log in logs {
        // A stream sees the acknowledgements of one worker after the other.
        let mut newest: BTreeMap<String, u64> = BTreeMap::new();
        for line in log.lines() {
            let Ok(line) = serde_json::from_str::<Value>(line) else { continue };
            let fields = &line["fields"];
            let (Some(map), Some(token)) = (fields["map"].as_str(), fields["token"].as_u64())
            else {
                continue;
            };
            match fields["message"].as_str().unwrap_or_default() {
                what @ ("took a map" | "checkpoint") => {
                    let revision = fields["revision"].as_u64().expect("it has one");
                    *if what == "checkpoint" {
                        &mut findings.checkpoints
                    } else {
                        &mut findings.taken
                    } += 1;
                    let change = (revision, token, what.to_owned());
                    changes.entry(map.to_owned()).or_default().push(change);
                }
                "acknowledged" => {
                    findings.acks += 1;
                    let stream = fields["stream"].as_str().unwrap_or_default();
                    let before = newest.entry(format!("{map} {stream}")).or_default();
                    if token < *before {
                        let sequence = &fields["sequence"];
                        findings.faults.push(format!(
                            "{map}: frame {sequence} acknowledged by owner {token} after owner {before}"
                        ));
                    }
                    *before = token.max(*before);
                }
                "an acknowledgement of an owner before was dropped" => findings.dropped += 1,
                _ => {}
            }
        }
    }
    for (map, mut changes) in changes {
        changes.sort();
        for pair in changes.windows(2) {
            let [(_, before, _), (revision, token, what)] = pair else { continue };
            if token < before {
                findings.faults.push(format!(
                    "{map}: {what:?} of owner {token} at revision {revision} after owner {before}"
                ));
            }
        }
    }
    findings
}

fn line(message: &str, token: u64, number: u64) -> String {
    let fields = serde_json::json!({
        "message": message, "map": "m", "token": token, "revision": number, "sequence": number, "stream": "s",
    });
    serde_json::json!({ "fields": fields }).to_string() + "\n"
}

#[test]
fn two_owners_are_found_and_one_after_the_other_are_not() {
    let first = line("took a map", 3, 4) + &line("checkpoint", 3, 5);
    let second = line("took a map", 8, 9) + &line("checkpoint", 8, 10);
    let gateway = line("acknowledged", 3, 1) + &line("acknowledged", 8, 2);
    let good = read(&[first.clone(), second.clone(), gateway.clone()]);
    assert_eq!((good.taken, good.checkpoints, good.acks), (2, 2, 2));
    assert!(good.faults.is_empty(), "{good:?}");
    let late = first + &line("checkpoint", 3, 11);
    let found = read(&[late, second.clone(), gateway.clone()]).faults;
    assert!(found.len() == 1 && found[0].contains("after owner 8"), "{found:?}");
    let found = read(&[second, gateway + &line("acknowledged", 3, 3)]).faults;
    assert!(found.len() == 1 && found[0].contains("frame 3"), "{found:?}");
}
