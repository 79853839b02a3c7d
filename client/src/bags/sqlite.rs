//! SQLite files of rosbag2: tables `topics` and `messages`.

use super::store::{Channel, Message, Place, Store};
use crate::dataset::DatasetError;
use rusqlite::{Connection, OpenFlags};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

const TABLES: [&str; 2] = ["topics", "messages"];

/// A SQLite file of rosbag2.
pub(super) struct SqliteFile {
    path: PathBuf,
    connection: Mutex<Connection>,
}

impl SqliteFile {
    /// Opens a file.
    ///
    /// # Errors
    /// [`DatasetError`] if it is no such file.
    pub(super) fn open(path: &Path) -> Result<Self, DatasetError> {
        let opened = std::fs::File::open(path);
        opened.map_err(|source| DatasetError::File { path: path.into(), source })?;
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags);
        let connection = connection.map_err(|error| failed(path, &error))?;
        let connection = Mutex::new(connection);
        Ok(Self { path: path.to_owned(), connection })
    }

    /// Refuses views and virtual tables of these names, which can have rows without end.
    fn check_tables(&self, connection: &Connection) -> Result<(), DatasetError> {
        for name in TABLES {
            let written = connection.query_row(
                "SELECT sql FROM sqlite_master \
                 WHERE type IN ('table', 'view') AND name = ?1 COLLATE NOCASE",
                [name],
                |row| row.get::<_, String>(0),
            );
            let found = match written {
                Ok(sql) if sql.to_ascii_uppercase().starts_with("CREATE TABLE") => continue,
                Ok(sql) => sql.split_whitespace().take(2).collect::<Vec<_>>().join(" "),
                Err(rusqlite::Error::QueryReturnedNoRows) => "none".into(),
                Err(error) => return Err(failed(&self.path, &error)),
            };
            let reason = format!("expected a bag of rosbag2 with a table {name}, found {found}");
            return Err(DatasetError::content(&self.path, reason));
        }
        Ok(())
    }

    fn channels(&self, connection: &Connection) -> rusqlite::Result<HashMap<i64, Channel>> {
        let mut statement =
            connection.prepare("SELECT id, name, type, serialization_format FROM topics")?;
        let rows = statement.query_map([], |row| {
            let (topic, schema, encoding) = (row.get(1)?, row.get(2)?, row.get(3)?);
            Ok((row.get(0)?, Channel { topic, encoding, schema }))
        })?;
        rows.collect()
    }
}

fn failed(path: &Path, error: &rusqlite::Error) -> DatasetError {
    DatasetError::content(path, format!("expected a SQLite file of rosbag2: {error}"))
}

impl Store for SqliteFile {
    fn scan(&self, take: &mut dyn FnMut(Message<'_>)) -> Result<Vec<String>, DatasetError> {
        let connection = self.connection.lock().unwrap_or_else(PoisonError::into_inner);
        self.check_tables(&connection)?;
        let channels = self.channels(&connection).map_err(|error| failed(&self.path, &error))?;
        let all = "SELECT id, topic_id, timestamp, data FROM messages ORDER BY id";
        let mut statement = connection.prepare(all).map_err(|error| failed(&self.path, &error))?;
        let mut rows = statement.query([]).map_err(|error| failed(&self.path, &error))?;
        let mut problems = Vec::new();
        let mut last = 0;
        loop {
            let row = match rows.next() {
                Ok(Some(row)) => row,
                Ok(None) => break,
                Err(error) => {
                    let path = self.path.display();
                    problems.push(format!("{path}: damaged behind message {last}: {error}"));
                    break;
                }
            };
            let fields = || -> rusqlite::Result<(i64, i64, i64, &[u8])> {
                let data = row.get_ref(3)?.as_blob()?;
                Ok((row.get(0)?, row.get(1)?, row.get(2)?, data))
            };
            let Ok((id, topic, nanos, data)) = fields() else {
                problems
                    .push(format!("{}: a message behind {last}: left out", self.path.display()));
                continue;
            };
            last = id;
            let Some(channel) = channels.get(&topic) else { continue };
            let place = Place { at: id as u64, nth: 0 };
            let nanos = u64::try_from(nanos).unwrap_or(0);
            take(Message { channel, nanos, place, data });
        }
        Ok(problems)
    }

    fn read(&self, place: Place) -> Result<Vec<u8>, DatasetError> {
        let connection = self.connection.lock().unwrap_or_else(PoisonError::into_inner);
        let read = || -> rusqlite::Result<Vec<u8>> {
            let mut statement = connection.prepare("SELECT data FROM messages WHERE id = ?1")?;
            statement.query_row([place.at as i64], |row| row.get(0))
        };
        read().map_err(|error| failed(&self.path, &error))
    }
}
