//! Frames that are scored against those of another data set.

use super::*;
use crate::dataset::Against;

#[test]
fn frames_are_sent_from_one_and_scored_against_the_other() {
    let (lens, ideal) = (replica(), seven_scenes());
    // The same numbers, another color and size.
    let part = range(0, Some(1), 1).of(open("replica", lens.path()).unwrap()).unwrap();
    let clean = || open("7scenes", ideal.path()).unwrap();
    let (sequence, size) = (clean().sequence(0), clean().intrinsics());
    let sent = part.frame(0).unwrap();
    assert_eq!(part.sequence(0), sequence);
    let against: Box<dyn Dataset> = Box::new(Against::new(part, clean()).unwrap());
    assert_eq!(against.intrinsics(), size);
    assert_eq!(against.frame(0).unwrap(), sent);
    assert_eq!(against.clean_frame(0).unwrap(), clean().frame(0).unwrap());
    assert_ne!(against.clean_frame(0).unwrap(), sent);
    assert!(against.simulated().unwrap().contains("scored against"));
}

#[test]
fn a_frame_that_is_missing_is_told_of() {
    let (lens, ideal) = (replica(), seven_scenes());
    let clean = range(1, Some(2), 1).of(open("7scenes", ideal.path()).unwrap()).unwrap();
    let error = Against::new(open("replica", lens.path()).unwrap(), clean).err().unwrap();
    assert!(error.to_string().contains("expected frame 0"), "{error}");
}
