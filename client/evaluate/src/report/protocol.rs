//! The part of a report that says how its numbers were measured, so that two reports can be
//! compared.

use super::record::Report;
use crate::labels::{
    ABSENT_NOUNS, COUNTED_EVERY, LABELS, LEAST_PIXELS, SMOOTHING, TEST_FRAMES, smoothing,
};
use crate::language::Language;
use crate::presence::VIEWS;
use crate::space::{PAIRED, SEEN_PIXELS, VOXEL_METRES};
use crate::views::HELD_OUT_EVERY;

/// The protocol of a report, as Markdown.
pub(super) fn protocol(report: &Report) -> String {
    let mut page = format!(
        "\n## Protocol\n\n\
         - **Speed**: *acknowledged* is the time from the opening of the stream to the last \
         acknowledgement, with reading (or rendering) the data set. A frame is acknowledged when it is \
         tracked; its optimisation and language may still wait. *All work done* adds the time until the \
         map is settled, language included. *Processor time* is the server's, user and system, of the \
         same period.\n\
         - **ATE**: all tracked frames, rigid alignment (Umeyama, no scale), distances of positions. Lost \
         frames do not count and are given apart. The paper counts keyframes only.\n\
         - **Held out**: {} ({}), rendered at the tracked pose. It is the same walk, so views are near \
         keyframes: this is not a new path. The map was optimised on the keyframes ({}).\n\
         - **PSNR, SSIM**: 8-bit RGB scaled to 0..1, all pixels, mean over frames. SSIM uses an 11x11 \
         Gaussian window (sigma 1.5) without the border. The paper leaves black pixels out of PSNR and \
         pads SSIM with zeros.\n\
         - **Depth L1**: pixels with measured and rendered depth{}.\n",
        match report.hold_out_every {
            Some(every) => format!("every {every}th frame was tracked and never a keyframe"),
            None => format!("every {HELD_OUT_EVERY}th of the tracked frames that are no keyframe"),
        },
        report.held_out.views,
        report.keyframe_views.views,
        match report.held_out.depth_share {
            Some(share) => format!(" ({:.1} % of the measured ones, held out)", share * 100.0),
            None => String::new(),
        }
    );
    if let Some(simulated) = &report.simulated {
        page += &format!(
            "- **Simulated sensor**: {simulated}. The server received these frames; views, depth and \
             clouds are compared with the clean frames, without the sensor.\n"
        );
    }
    if let Some(language) = &report.language {
        page += &frame_queries(language, smoothing(report.frame_size[0] as usize));
        page += &map_queries(language);
    }
    page
}

/// `side` is that of the mean filter on this report's frames, pixels.
fn frame_queries(language: &Language, side: usize) -> String {
    let labels = match &language.file {
        Some(file) => format!(
            "the labels of {file}, in at most {TEST_FRAMES} of its frames that are in the map, keyframes \
             or not. Labels that a frame does not list are not judged there"
        ),
        None => format!(
            "the {LABELS} classes with most pixels over every {COUNTED_EVERY}th tracked frame, walls, floor \
             and ceiling included; at most {TEST_FRAMES} frames, evenly spaced over the tracked frames \
             that are no keyframe (the paper: 21 at random, or 16 by list)"
        ),
    };
    format!(
        "- **Queries about frames**: {labels}. A label with a mask counts in a frame where it has \
         {LEAST_PIXELS} pixels. The relevancy map at frame size is smoothed by a mean of {SMOOTHING} pixels \
         in 1200 columns, as in the paper ({side} here). *Loc box*: the peak lies in a box of the label; \
         with a mask, in a box around a connected region of it. *Loc synonyms*: the same, asked by the \
         label's other names. {}The value of a frame is the mean over its labels, that of the scene the \
         mean over frames.\n",
        if language.scene.masks.is_some() { MASKS } else { "" }
    )
}

/// What scores against masks mean.
const MASKS: &str = "\
    *IoU at 0.5*: the paper's threshold; its relevancies are of another feature space, in which 0.5 \
    means something else. *IoU released*: the map and its 30-pixel mean averaged, scaled to 0..1 over \
    the frame, above 0.75, 7x7 majority. *Argmax*: each pixel has the label with the highest relevancy. \
    *Loc object*: the peak lies on the label itself. *AP*: average precision over pixels, without a \
    threshold; `share` is the AP of a constant map. ";

fn map_queries(language: &Language) -> String {
    let presence = match &language.file {
        Some(file) => format!(
            "- **Presence**: the labels by their queries, and the nouns that {file} calls absent, asked \
             about the whole map and about {VIEWS} views (labels where the file lists them)."
        ),
        None => format!(
            "- **Queries about the whole map**: truth is the labelled pixels of every {COUNTED_EVERY}th \
             frame with depth, back-projected with the true poses, in voxels of {VOXEL_METRES} m. Found are \
             the points of the 3D answer at the bundle's threshold, moved by the rigid alignment of the \
             trajectory. *Chamfer*: mean distance to the nearest point, both ways, added. *EMD*: mean \
             distance of the best one-to-one pairs of {PAIRED} points of each, exact. A failure is farther \
             than mean + 2 standard deviations over the labels, as in the paper. An object counts as there \
             if a counted frame shows it with {SEEN_PIXELS} pixels.\n\
             - **Presence**: the same classes, and {ABSENT_NOUNS} household nouns that the scene does not \
             have, asked about the whole map and about {VIEWS} views."
        ),
    };
    format!(
        "{presence} *Calibration error*: ten bins of confidence, mean of |confidence - share there|, \
         weighted by size. *Wrong pixels*: in the mask and on something else, or the other way round, over \
         the same answers about views; the least certain tenth by the server's uncertainty, and the mean of \
         |mean uncertainty - share wrong| over tenths.\n"
    )
}
