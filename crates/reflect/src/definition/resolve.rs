//! From names of types to the types.

use std::sync::Arc;

use super::parse::{RawField, Repeated, Section};
use super::{Choice, DefinitionError, DefinitionFault, Layout, RecordField, RecordType, Shape};
use crate::Primitive;
use crate::view::DEPTH_MAX;

/// The types that the first section reaches, itself first.
pub(super) fn records(sections: &[Section<'_>]) -> Result<Vec<RecordType>, DefinitionError> {
    let mut resolver = Resolver { sections, found: Vec::new() };
    resolver.section(0, 0)?;
    Ok(resolver.found.into_iter().filter_map(|(_, record)| record).collect())
}

struct Resolver<'s, 't> {
    sections: &'s [Section<'t>],
    /// Sections met, in the order they are met; the record once it is whole.
    found: Vec<(usize, Option<RecordType>)>,
}

/// A field's type before it is repeated.
struct Element {
    shape: Shape,
    layout: Arc<Layout>,
}

impl Resolver<'_, '_> {
    /// The place of a section among the records.
    fn section(&mut self, index: usize, depth: u32) -> Result<usize, DefinitionError> {
        let place = self.found.len();
        self.found.push((index, None));
        let sections = self.sections;
        let section = &sections[index];
        let mut fields = Vec::with_capacity(section.fields.len());
        let mut layouts = Vec::with_capacity(section.fields.len());
        for raw in &section.fields {
            let element = self.element(section, raw, depth)?;
            let (shape, layout) = repeat(element, raw);
            fields.push(RecordField {
                name: raw.name.to_owned(),
                shape,
                unit: raw.notes.unit.map(str::to_owned),
            });
            layouts.push(layout);
        }
        let layout = Arc::new(Layout::sequence(layouts));
        self.found[place].1 = Some(RecordType { name: section.name.to_owned(), fields, layout });
        Ok(place)
    }

    fn element(
        &mut self,
        section: &Section<'_>,
        raw: &RawField<'_>,
        depth: u32,
    ) -> Result<Element, DefinitionError> {
        if let Some(primitive) = Primitive::of_ros1(raw.type_name) {
            let layout = Arc::new(Layout::Fixed(primitive.size().into()));
            let choice = raw.notes.values_of.and_then(|name| choice(section, name, primitive));
            let shape = choice.map_or(Shape::Primitive(primitive), Shape::Enumeration);
            return Ok(Element { shape, layout });
        }
        if raw.type_name == "string" {
            let bound = raw.notes.bytes_max.unwrap_or(u32::MAX);
            return Ok(Element { shape: Shape::Text { bound }, layout: Arc::new(Layout::Text { bound }) });
        }
        let refused = |fault| DefinitionError::new(raw.line, raw.text, fault);
        let name = full_name(section.name, raw.type_name);
        let index = self.sections.iter().position(|known| known.name == name);
        let index = index.ok_or_else(|| refused(DefinitionFault::UnknownType { name }))?;
        let place = match self.found.iter().position(|(section, _)| *section == index) {
            Some(place) => place,
            None if depth < DEPTH_MAX => self.section(index, depth + 1)?,
            None => return Err(refused(DefinitionFault::TooDeep)),
        };
        // Met and not whole: it contains itself.
        let record = self.found[place].1.as_ref().ok_or_else(|| refused(DefinitionFault::TooDeep))?;
        Ok(Element { shape: Shape::Record(place), layout: Arc::clone(&record.layout) })
    }
}

/// A type without a package is one of the same package, but for ROS's `Header`.
fn full_name(within: &str, name: &str) -> String {
    match (name.contains('/'), within.split_once('/')) {
        (false, _) if name == "Header" => "std_msgs/Header".to_owned(),
        (false, Some((package, _))) => format!("{package}/{name}"),
        _ => name.to_owned(),
    }
}

/// The choice of that name, where its values are of the field's type.
fn choice(section: &Section<'_>, name: &str, primitive: Primitive) -> Option<Arc<Choice>> {
    let choice = section.choices.iter().find(|choice| choice.name == name)?;
    let width = match primitive {
        Primitive::U8 => 1,
        Primitive::U32 => 4,
        _ => return None,
    };
    (choice.width == width).then(|| {
        let constants = choice.constants.clone();
        Arc::new(Choice { name: choice.name.clone(), width, constants })
    })
}

fn repeat(element: Element, raw: &RawField<'_>) -> (Shape, Arc<Layout>) {
    let Element { shape, layout } = element;
    match raw.repeated {
        Repeated::Once => (shape, layout),
        Repeated::Counted => {
            let bound = raw.notes.elements_max.unwrap_or(u32::MAX);
            let layout = Layout::Seq { element: layout, bound };
            (Shape::Seq { element: Box::new(shape), bound }, Arc::new(layout))
        }
        Repeated::Times(length) => {
            let layout = Layout::array(layout, length);
            (Shape::Array { element: Box::new(shape), length }, Arc::new(layout))
        }
    }
}
