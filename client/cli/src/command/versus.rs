//! `lexsplat evaluate --versus`: two builds of the server are measured in turns on one data set, and
//! compared by ratios. Turns, since the speed of a machine changes from minute to minute.
//!
//! Each turn leaves the report of an evaluation in a folder of its own; `versus.json` and `versus.md`
//! have the comparison of the rounds that are finished.

use super::measure::{measure_own, settings, write};
use crate::files::{make_folder, save};
use crate::server::Plan;
use anyhow::{Context as _, Result, bail};
use lexsplat_client::dataset::Dataset;
use lexsplat_evaluate::table::{markdown_table, table};
use lexsplat_evaluate::{Comparison, Options, Report};
use std::num::NonZeroUsize;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

/// How each build says what it is, with `--version`.
const PROGRAM: &str = "lexsplat-server";
/// Names of the builds in folders and messages.
const NAMES: [&str; 2] = ["this", "that"];

/// What is measured, and how often.
pub struct Turns<'a> {
    /// The binaries: this one, and the one to compare it with.
    pub builds: [PathBuf; 2],
    /// The plan of a server by its binary and the file for its log.
    pub plan: &'a dyn Fn(PathBuf, PathBuf) -> Plan,
    /// What to measure in each turn.
    pub options: &'a dyn Fn() -> Result<Options>,
    /// The frames of every turn.
    pub dataset: Arc<dyn Dataset>,
    /// Name of the map, if it is given.
    pub map: Option<String>,
    /// How often each build is measured.
    pub rounds: NonZeroUsize,
    /// Folder for the results.
    pub out: &'a Path,
}

impl Turns<'_> {
    /// Measures this, that, this, that and so on, and prints the comparison.
    ///
    /// # Errors
    /// If a binary is no build of the server or refuses the settings, which is found before anything
    /// is measured, or if a turn fails.
    pub async fn run(mut self) -> Result<()> {
        for build in &mut self.builds {
            *build = checked(build)?;
            // An older build may not know all keys of a settings file.
            let plan = (self.plan)(build.clone(), self.out.join("server.log"));
            settings(&plan).with_context(|| build.display().to_string())?;
        }
        let mut rounds = Vec::new();
        for round in 1..=self.rounds.get() {
            rounds.push([self.turn(round, 0).await?, self.turn(round, 1).await?]);
            self.save(&rounds)?;
        }
        let comparison = self.comparison(&rounds);
        say!("{}", heading(&comparison))?;
        say_part!("{}", table(&Comparison::columns(), &comparison.rows()))?;
        say!("\nreport     {}", self.out.join("versus.md").display())?;
        Ok(())
    }

    async fn turn(&self, round: usize, build: usize) -> Result<Report> {
        let (program, name) = (&self.builds[build], NAMES[build]);
        let rounds = self.rounds;
        let turn = || format!("round {round} of {rounds}, {name} ({})", program.display());
        note!("{}", turn());
        let out = self.out.join(format!("{name}-{round}"));
        make_folder(&out)?;
        let plan = (self.plan)(program.clone(), out.join("server.log"));
        let measured =
            measure_own(plan, self.dataset.clone(), self.map.clone(), (self.options)()?).await;
        let evaluation = measured.with_context(turn)?;
        write(&out, &evaluation)?;
        let report = evaluation.report;
        let psnr = report.psnr_db.map(|psnr| format!(", {psnr:.2} dB")).unwrap_or_default();
        note!("  {:.3} s per frame{psnr}", report.seconds_per_frame_settled);
        Ok(report)
    }

    fn comparison(&self, rounds: &[[Report; 2]]) -> Comparison {
        let names = self.builds.each_ref().map(|build| build.display().to_string());
        Comparison::new(names, rounds)
    }

    fn save(&self, rounds: &[[Report; 2]]) -> Result<()> {
        let comparison = self.comparison(rounds);
        let page = format!(
            "# {}\n\n{}",
            heading(&comparison).replace('\n', "\n\n"),
            markdown_table(&Comparison::columns(), &comparison.rows())
        );
        save(&self.out.join("versus.json"), serde_json::to_string_pretty(&comparison)?)?;
        save(&self.out.join("versus.md"), page)
    }
}

fn heading(comparison: &Comparison) -> String {
    let Comparison { dataset, frames, rounds, this, that, .. } = comparison;
    format!(
        "{dataset}: {frames} frames, {rounds} rounds\nthis: {this}\nthat: {that}\n\
         Values are means over rounds; ratios are this build over that one, with the lowest and the highest of \
         a round.\n\
         Times of equal builds have both on the same side of 1 in one row of {} by chance; more --rounds make \
         that rarer.\n\
         Scaled ratios are of times divided by the probe's.\n",
        comparison.one_in()
    )
}

/// The full path of a binary that says that it is a server.
fn checked(program: &Path) -> Result<PathBuf> {
    let named = program.display();
    let Ok(full) = program.canonicalize() else {
        bail!(
            "no {named}: name the binary of a build of the server, such as a copy of \
             target/release/{PROGRAM} that was kept before the next build"
        );
    };
    let about = full.metadata().with_context(|| format!("cannot read {named}"))?;
    if !about.is_file() {
        bail!("{named} is not a file: name the binary {PROGRAM} in it");
    }
    if about.permissions().mode() & 0o111 == 0 {
        bail!("{named} cannot be executed: chmod +x {named}");
    }
    let said = Command::new(&full).arg("--version").stdin(Stdio::null()).output();
    let said = said.with_context(|| format!("cannot start {named}"))?;
    let first_line = |text: &[u8]| {
        String::from_utf8_lossy(text).lines().next().unwrap_or_default().trim().to_owned()
    };
    let (version, complaint) = (first_line(&said.stdout), first_line(&said.stderr));
    if !said.status.success() || !version.starts_with(PROGRAM) {
        let said = said.status;
        bail!(
            "{named} is no build of {PROGRAM}: asked for --version, it said {version:?} {complaint:?} ({said})"
        );
    }
    Ok(full)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::ONE_AT_A_TIME;
    use std::fs::Permissions;

    /// A script that says what follows `#!/bin/sh`.
    fn script(folder: &Path, name: &str, text: &str, mode: u32) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(mode)).unwrap();
        path
    }

    #[test]
    fn only_a_server_is_taken_and_others_are_told_why() {
        let _alone = ONE_AT_A_TIME.blocking_lock();
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let refused = |path: &Path| format!("{:#}", checked(path).unwrap_err());
        let good = script(folder, "good", "echo lexsplat-server 0.1.0", 0o755);
        assert_eq!(checked(&good).unwrap(), good.canonicalize().unwrap());

        let missing = refused(&folder.join("nowhere"));
        assert!(missing.contains("nowhere") && missing.contains("a copy of"), "{missing}");
        assert!(refused(folder).contains("not a file"));
        let plain = script(folder, "plain", "echo lexsplat-server 0.1.0", 0o644);
        assert!(refused(&plain).contains("chmod +x"));
        let other = refused(&script(folder, "other", "echo another program", 0o755));
        assert!(other.contains("no build of") && other.contains("another program"), "{other}");
        let ends =
            refused(&script(folder, "ends", "echo lexsplat-server; echo oh no >&2; exit 3", 0o755));
        assert!(ends.contains("oh no") && ends.contains("exit status: 3"), "{ends}");
        let noise = folder.join("noise");
        std::fs::write(&noise, [0_u8, 1, 2, 3]).unwrap();
        std::fs::set_permissions(&noise, Permissions::from_mode(0o755)).unwrap();
        assert!(refused(&noise).contains("cannot start"));
    }
}
