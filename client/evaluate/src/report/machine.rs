//! The part of a report that says how fast the machine was: the probe, as Markdown.

use crate::probe::{Probe, ProbeTimes, Repeated};
use crate::table::{Column, markdown_table};

/// The probe before and after the run beside the reference.
pub(super) fn machine(probe: &Probe) -> String {
    let Probe { before, after, reference, .. } = probe;
    let columns = [
        Column::left("part"),
        Column::right("before, ms"),
        Column::right("after, ms"),
        Column::right("reference, ms"),
    ];
    let row = |what: &str, of: fn(&ProbeTimes) -> Option<Repeated>, reference_ms: f64| {
        let shown = |part: Option<Repeated>| match part {
            Some(part) => format!("{:.1} (least {:.1})", part.median_ms, part.min_ms),
            None => "–".to_owned(),
        };
        vec![what.to_owned(), shown(of(before)), shown(of(after)), format!("{reference_ms:.1}")]
    };
    let rows = [
        row("64 MiB copied four times", |times| Some(times.memory), reference.memory_ms),
        row("Gaussians blended", |times| Some(times.blend), reference.blend_ms),
        row("matrices of 1536x1536 multiplied", |times| times.product, reference.product_ms),
    ];
    let missing = match &before.without_product {
        Some(reason) => format!("\nThe product was not measured: {reason}.\n"),
        None => String::new(),
    };
    format!(
        "\n## Probe\n\nA fixed piece of work on {} cores of this machine, in the evaluating program, medians. \
         It took {:.2} times as long as on the reference ({}), and after the run {:.2} times as long as \
         before it. Scaled times are divided by the first number. It says nothing about a GPU.\n\n{}{missing}",
        probe.cores,
        probe.relative_time,
        reference.name,
        probe.change,
        markdown_table(&columns, &rows)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example::example_probe;

    #[test]
    fn a_part_that_is_missing_is_named() {
        let mut probe = example_probe();
        let page = machine(&probe);
        assert!(page.contains("2.00 times as long as on the reference (two"), "{page}");
        assert!(!page.contains('–') && !page.contains("not measured"), "{page}");
        probe.before.product = None;
        probe.before.without_product = Some("no library".into());
        let page = machine(&probe);
        assert!(page.contains('–') && page.contains("not measured: no library."), "{page}");
    }
}
