//! A definition that is parsed from its text reads every body as the schema does that the text came from.

use proptest::prelude::*;
use reflect::{Definition, Kind, Schema, Value};
use schemas::topics;

/// Draws bodies of a schema, from numbers that proptest can shrink.
struct Draw<'n> {
    numbers: &'n [u64],
    next: usize,
    body: Vec<u8>,
}

impl Draw<'_> {
    fn number(&mut self) -> u64 {
        self.next += 1;
        self.numbers[self.next % self.numbers.len()].rotate_left(self.next as u32)
    }

    fn bytes(&mut self, count: usize) {
        let bytes = self.number().to_le_bytes();
        self.body.extend_from_slice(&bytes[..count]);
    }

    fn count(&mut self, bound: u32) -> u32 {
        let count = (self.number() % 5).min(bound.into()) as u32;
        self.body.extend(count.to_le_bytes());
        count
    }

    fn record(&mut self, schema: &Schema) {
        schema.fields.iter().for_each(|field| self.value(&field.kind));
    }

    fn value(&mut self, kind: &Kind) {
        match *kind {
            Kind::Bool => {
                let byte = (self.number() & 1) as u8;
                self.body.push(byte);
            }
            Kind::I8 | Kind::U8 => self.bytes(1),
            Kind::I16 | Kind::U16 => self.bytes(2),
            Kind::I32 | Kind::U32 => self.bytes(4),
            Kind::I64 | Kind::U64 => self.bytes(8),
            // Finite: two that are not numbers are not equal.
            Kind::F32 => {
                let number = self.number() as u32 as f32 / 7.0;
                self.body.extend(number.to_le_bytes());
            }
            Kind::F64 => {
                let number = self.number() as f64 / -7.0;
                self.body.extend(number.to_le_bytes());
            }
            Kind::Time => {
                self.bytes(4);
                let nanos = (self.number() % 1_000_000_000) as u32;
                self.body.extend(nanos.to_le_bytes());
            }
            Kind::Text { bound } => {
                let count = self.count(bound);
                self.body.extend(std::iter::repeat_n(b'x', count as usize));
            }
            Kind::Seq { element, bound } => {
                let count = self.count(bound);
                (0..count).for_each(|_| self.value(element));
            }
            Kind::Array { element, length } => (0..length).for_each(|_| self.value(element)),
            Kind::Message(schema) => self.record(schema),
            Kind::Enumeration(choice) => {
                let place = self.number() as usize % choice.constants.len();
                let value = choice.constants[place].value.to_le_bytes();
                self.body.extend_from_slice(&value[..choice.width.into()]);
            }
        }
    }
}

fn assert_alike(schema: &'static Schema, definition: &Definition, body: &[u8]) {
    let (by_schema, by_text) = (Value::decode(schema, body), definition.decode(body));
    // As text, since a number that is none is not even equal to itself.
    assert_eq!(format!("{by_text:?}"), format!("{by_schema:?}"), "{}", schema.name);
    let (Ok(by_schema), Ok(by_text)) = (by_schema, by_text) else { return };
    assert_eq!(serde_json::to_string(&by_text).unwrap(), serde_json::to_string(&by_schema).unwrap());
    for leaf in definition.leaves().unwrap() {
        let read = definition.field(&leaf.path).unwrap();
        let (read, expected) = (read.read(body).unwrap(), by_schema.at(&leaf.path));
        assert_eq!(format!("{read:?}"), format!("{:?}", expected.cloned()), "{}.{}", schema.name, leaf.path);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn every_type_of_the_table_is_read_as_its_schema_reads_it(
        numbers in prop::collection::vec(any::<u64>(), 1..40), cut in 0_usize..400,
        place in 0_usize..400, byte: u8
    ) {
        for topic in topics::ALL {
            let definition = Definition::parse(topic.schema.name, topic.schema_text()).unwrap();
            let mut draw = Draw { numbers: &numbers, next: 0, body: Vec::new() };
            draw.record(topic.schema);
            let mut body = draw.body;
            prop_assert!(definition.decode(&body).is_ok(), "{}", topic.name);
            assert_alike(topic.schema, &definition, &body);
            if let Some(target) = body.get_mut(place) {
                *target = byte;
            }
            assert_alike(topic.schema, &definition, &body);
            body.truncate(cut);
            assert_alike(topic.schema, &definition, &body);
        }
    }
}

#[test]
fn units_come_back() {
    for topic in topics::ALL {
        let definition = Definition::parse(topic.schema.name, topic.schema_text()).unwrap();
        for (field, parsed) in topic.schema.fields.iter().zip(&definition.root().fields) {
            let unit = field.unit.map(|unit| unit.symbol.to_owned());
            assert_eq!((&parsed.name[..], &parsed.unit), (field.name, &unit), "{}", topic.name);
        }
    }
}
