//! `arena echo`: messages as they come.

use std::io::{self, Write as _};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use front_door::tools::{Heard, Tick, ToolError, write_message};
use recording::export::{Address, Content, FieldOf, Line, write_cell};
use recording::{Recording, Selection};
use reflect::{Definition, FieldReader};

use super::Failure;
use super::listening::{Place, Stretch, address, go_through, listen};

/// Options of `arena echo`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// A topic, or a field of it: `vehicle/state.estimate.position_m.x`.
    #[arg(value_name = "TOPIC[.FIELD]")]
    wanted: String,
    /// A recording; the live bus if none is named.
    file: Option<PathBuf>,
    /// End after so many messages.
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// Only messages that name this vehicle.
    #[arg(long, value_name = "ID")]
    vehicle: Option<u64>,
    /// Print one JSON object per line.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    stretch: Stretch,
    #[command(flatten)]
    place: Place,
}

/// Runs the command: exit code 1 where something could not be read.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if arguments.count == Some(0) {
        return Ok(ExitCode::SUCCESS);
    }
    let ended = match &arguments.file {
        Some(file) => {
            let recording = Recording::open(file)?;
            let Address { topic, field } = address(&recording, &arguments.wanted)?;
            let (from, to) = arguments.stretch.ends(&recording)?;
            let selection = Selection { from, to, ..Selection::topic(topic) };
            let mut printer = Printer::new(arguments, Some(&recording));
            let damage = go_through(&recording, &selection, |heard| printer.print(heard, field.as_deref()))?;
            (printer.end()?, damage)
        }
        None => {
            arguments.stretch.refuse_live()?;
            let setup = arguments.place.setup()?;
            let mut printer = Printer::new(arguments, None);
            let wanted = arguments.wanted.clone();
            let wants = move |topic: &str| Address::field_of(&wanted, topic).is_some();
            listen(&setup, wants, None, |tick| match tick {
                Tick::Heard(heard) => match Address::field_of(&arguments.wanted, heard.topic) {
                    Some(FieldOf::Message) => printer.print(&heard, None),
                    Some(FieldOf::Field(field)) => printer.print(&heard, Some(field)),
                    None => Ok(ControlFlow::Continue(())),
                },
                Tick::Now(..) => {
                    printer.out.flush()?;
                    Ok(ControlFlow::Continue(()))
                }
            })?;
            (printer.end()?, ExitCode::SUCCESS)
        }
    };
    Ok(if ended.0 { ended.1 } else { ExitCode::FAILURE })
}

/// Prints what is wanted of each message.
struct Printer<'a> {
    arguments: &'a Arguments,
    recording: Option<&'a Recording>,
    out: io::BufWriter<io::StdoutLock<'static>>,
    printed: u64,
    /// The field's reader, with the type it is for: that of the message before, most of the time.
    reader: Option<(String, FieldReader)>,
    refused: Option<String>,
    unreadable: u64,
    line: Vec<u8>,
}

impl<'a> Printer<'a> {
    fn new(arguments: &'a Arguments, recording: Option<&'a Recording>) -> Self {
        Self {
            arguments,
            recording,
            out: io::BufWriter::new(io::stdout().lock()),
            printed: 0,
            reader: None,
            refused: None,
            unreadable: 0,
            line: Vec::new(),
        }
    }

    fn print(&mut self, heard: &Heard<'_>, field: Option<&str>) -> Result<ControlFlow<()>, ToolError> {
        if self.arguments.vehicle.is_some_and(|wanted| heard.vehicle() != Some(wanted)) {
            return Ok(ControlFlow::Continue(()));
        }
        match (field, self.arguments.json) {
            (None, true) => self.json(heard),
            (None, false) => {
                let seconds = self.recording.map_or(heard.at.as_secs_f64(), |file| file.seconds_at(heard.at));
                self.line.clear();
                write_message(&mut self.line, heard, seconds)?;
            }
            (Some(path), _) => {
                if !self.field(heard, path) {
                    return Ok(ControlFlow::Break(()));
                }
            }
        }
        self.out.write_all(&self.line)?;
        self.printed += 1;
        let enough = self.arguments.count.is_some_and(|count| self.printed >= count);
        Ok(if enough { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    }

    fn json(&mut self, heard: &Heard<'_>) {
        let decoded = match heard.definition {
            Some(definition) => definition.decode(heard.body).map_err(|error| error.to_string()),
            None => Err("no definition".to_owned()),
        };
        let content = decoded.map_or_else(
            |reason| {
                self.unreadable += 1;
                Content::Raw(heard.body, reason)
            },
            Content::Body,
        );
        self.line.clear();
        line_of(self.recording, heard, content).write(&mut self.line);
    }

    /// Puts the field into the line; `false` if there is no such field, or no way to know.
    fn field(&mut self, heard: &Heard<'_>, path: &str) -> bool {
        self.line.clear();
        let read = match heard.definition {
            None => Err("no definition".to_owned()),
            Some(definition) => match reader_for(&mut self.reader, definition, path) {
                Ok(reader) => reader.read(heard.body).map_err(|error| error.to_string()),
                Err(reason) => {
                    self.refused = Some(format!("{}: {reason}", heard.topic));
                    return false;
                }
            },
        };
        match (read, self.arguments.json) {
            (Ok(value), true) => {
                let content = Content::Fields(vec![(path, value)]);
                line_of(self.recording, heard, content).write(&mut self.line);
            }
            (Ok(value), false) => {
                if let Some(value) = value {
                    write_cell(&mut self.line, &value);
                }
                self.line.push(b'\n');
            }
            (Err(reason), json) => {
                self.unreadable += 1;
                if json {
                    line_of(self.recording, heard, Content::Raw(heard.body, reason)).write(&mut self.line);
                } else {
                    eprintln!("{} at {}: {reason}", heard.topic, heard.at);
                }
            }
        }
        true
    }

    /// Whether everything could be read.
    fn end(mut self) -> Result<bool, Failure> {
        self.out.flush()?;
        match self.refused {
            Some(reason) => Err(Failure::Usage(reason)),
            None => Ok(self.unreadable == 0),
        }
    }
}

fn reader_for<'r>(
    known: &'r mut Option<(String, FieldReader)>,
    definition: &Definition,
    path: &str,
) -> Result<&'r FieldReader, String> {
    if known.as_ref().is_none_or(|(name, reader)| name != path || !reader.is_of(definition)) {
        *known = Some((path.to_owned(), definition.field(path).map_err(|error| error.to_string())?));
    }
    known.as_ref().map(|(_, reader)| reader).ok_or_else(String::new)
}

fn line_of<'h>(recording: Option<&Recording>, heard: &Heard<'h>, content: Content<'h>) -> Line<'h> {
    Line {
        topic: heard.topic,
        at_ns: heard.at,
        published_at_ns: heard.published_at,
        time_s: recording.map(|recording| recording.seconds_at(heard.at)),
        source: heard.source,
        incarnation: heard.incarnation,
        sequence: heard.sequence,
        verified: heard.verified,
        type_name: heard.type_name,
        content,
    }
}
