//! What the metadata of an array say, in version 2 (`.zarray`) and 3 (`zarr.json`). Source: the Zarr
//! specifications, versions 2 and 3.1, and their codecs.

use serde_json::Value;
use vacua_volume::ScalarType;

use super::unpack::Packing;
use super::wrong;
use crate::decode::Endianness;
use crate::error::Problem;

/// Most axes of an array.
const MOST_AXES: usize = 16;

/// Most bytes of a chunk, unpacked.
const MOST_CHUNK_BYTES: usize = 4 << 30;

/// What a number is in the chunks, which is not always what it becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stored {
    Same(ScalarType),
    /// Half precision, which becomes `f32`.
    Half,
}

impl Stored {
    /// Type of numbers of the same size, which they are moved as.
    pub fn as_moved(self) -> ScalarType {
        match self {
            Self::Same(scalar_type) => scalar_type,
            Self::Half => ScalarType::U16,
        }
    }

    /// Type that they become.
    pub fn as_read(self) -> ScalarType {
        match self {
            Self::Same(scalar_type) => scalar_type,
            Self::Half => ScalarType::F32,
        }
    }
}

/// How the numbers of a chunk become bytes, and these others.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Codecs {
    /// The axis of the array that each axis of the chunk as it is stored is.
    pub order: Vec<usize>,
    pub endianness: Endianness,
    /// In the order in which they were applied.
    pub packing: Vec<Packing>,
}

/// Chunks that lie together in a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shards {
    /// Numbers a side of one.
    pub shape: Vec<usize>,
    /// Whether where its chunks lie is said at its end, or else at its start.
    pub index_is_last: bool,
    pub index_endianness: Endianness,
    pub index_packing: Vec<Packing>,
}

/// Names of files that hold chunks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChunkNames {
    /// Whether they begin with `c`, as version 3 wants it.
    pub begin_with_c: bool,
    pub separator: char,
}

impl ChunkNames {
    pub fn of(self, place: &[usize]) -> String {
        let mut parts: Vec<String> = place.iter().map(ToString::to_string).collect();
        if self.begin_with_c {
            parts.insert(0, "c".to_owned());
        }
        parts.join(self.separator.encode_utf8(&mut [0; 4]))
    }
}

/// An array, by its metadata.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ArrayMeta {
    /// Numbers a side.
    pub shape: Vec<usize>,
    /// Numbers a side of a chunk.
    pub chunk: Vec<usize>,
    pub stored: Stored,
    /// What is not stored, in native bytes.
    pub fill: Vec<u8>,
    pub names: ChunkNames,
    pub codecs: Codecs,
    pub shards: Option<Shards>,
    /// Names of the axes, if they have any.
    pub axes: Option<Vec<String>>,
    pub attributes: Value,
}

/// A list of sizes.
fn sizes(place: &str, value: &Value) -> Result<Vec<usize>, Problem> {
    let numbers = value
        .as_array()
        .filter(|all| (1..=MOST_AXES).contains(&all.len()));
    let sizes = numbers.and_then(|all| {
        let size = |n: &Value| usize::try_from(n.as_u64()?).ok();
        all.iter().map(size).collect::<Option<Vec<_>>>()
    });
    sizes.ok_or_else(|| wrong(place, &format!("1 to {MOST_AXES} sizes"), value))
}

/// Sizes of chunks: as many as axes, and none 0.
fn chunk_sizes(place: &str, value: &Value, num_axes: usize) -> Result<Vec<usize>, Problem> {
    let chunk = sizes(place, value)?;
    if chunk.len() != num_axes || chunk.contains(&0) {
        return Err(wrong(place, &format!("{num_axes} sizes above 0"), value));
    }
    Ok(chunk)
}

fn separator(place: &str, value: &Value, default: char) -> Result<char, Problem> {
    match value {
        Value::Null => Ok(default),
        Value::String(text) if text == "/" => Ok('/'),
        Value::String(text) if text == "." => Ok('.'),
        other => Err(wrong(place, "`/` or `.`", other)),
    }
}

impl ArrayMeta {
    /// Reads `.zarray`.
    ///
    /// # Errors
    /// [`Problem`] naming the member that is wrong or not supported.
    pub fn of_version_2(meta: &Value, attributes: Value) -> Result<Self, Problem> {
        let shape = sizes("shape", &meta["shape"])?;
        let chunk = chunk_sizes("chunks", &meta["chunks"], shape.len())?;
        if meta["filters"]
            .as_array()
            .is_some_and(|all| !all.is_empty())
        {
            let what = format!("the filters {}", meta["filters"]);
            return Err(Problem::unsupported(what));
        }
        let (stored, endianness) = type_of_version_2(&meta["dtype"])?;
        let order: Vec<usize> = match meta["order"].as_str() {
            None | Some("C") => (0..shape.len()).collect(),
            Some("F") => (0..shape.len()).rev().collect(),
            Some(_) => return Err(wrong("order", "C or F", &meta["order"])),
        };
        let packing = match &meta["compressor"] {
            Value::Null => Vec::new(),
            compressor => {
                let name = compressor["id"].as_str();
                let name = name.ok_or_else(|| wrong("compressor", "an `id`", compressor))?;
                vec![Packing::of_name(name, compressor)?]
            }
        };
        let array = Self {
            fill: fill(stored, &meta["fill_value"])?,
            names: ChunkNames {
                begin_with_c: false,
                separator: separator("dimension_separator", &meta["dimension_separator"], '.')?,
            },
            codecs: Codecs {
                order,
                endianness,
                packing,
            },
            shards: None,
            axes: names_of(&attributes["_ARRAY_DIMENSIONS"], shape.len()),
            shape,
            chunk,
            stored,
            attributes,
        };
        array.checked()
    }

    /// Reads the `zarr.json` of an array.
    ///
    /// # Errors
    /// As [`ArrayMeta::of_version_2`].
    pub fn of_version_3(meta: &Value) -> Result<Self, Problem> {
        let shape = sizes("shape", &meta["shape"])?;
        let stored = type_of_version_3(&meta["data_type"])?;
        let grid = &meta["chunk_grid"];
        if grid["name"] != "regular" {
            return Err(Problem::unsupported(format!(
                "the chunk grid {}",
                grid["name"]
            )));
        }
        let of_files = &grid["configuration"]["chunk_shape"];
        let of_files = chunk_sizes("chunk_shape", of_files, shape.len())?;
        let transformers = &meta["storage_transformers"];
        if transformers.as_array().is_some_and(|all| !all.is_empty()) {
            let what = format!("the storage transformers {transformers}");
            return Err(Problem::unsupported(what));
        }
        let encoding = &meta["chunk_key_encoding"];
        let own = &encoding["configuration"]["separator"];
        let (begin_with_c, default) = match encoding["name"].as_str() {
            Some("default") => (true, '/'),
            Some("v2") => (false, '.'),
            _ => return Err(wrong("chunk_key_encoding", "`default` or `v2`", encoding)),
        };
        let (chunk, codecs, shards) = codecs_and_shards(&meta["codecs"], of_files)?;
        let array = Self {
            fill: fill(stored, &meta["fill_value"])?,
            names: ChunkNames {
                begin_with_c,
                separator: separator("separator", own, default)?,
            },
            codecs,
            shards,
            axes: names_of(&meta["dimension_names"], shape.len()),
            shape,
            chunk,
            stored,
            attributes: meta["attributes"].clone(),
        };
        array.checked()
    }

    /// Bytes of a chunk, unpacked.
    pub fn chunk_bytes(&self) -> usize {
        self.chunk.iter().product::<usize>() * self.stored.as_moved().size_bytes()
    }

    /// Refuses chunks that no memory holds.
    fn checked(self) -> Result<Self, Problem> {
        let size = self.stored.as_moved().size_bytes();
        let bytes = self
            .chunk
            .iter()
            .try_fold(size, |n, &side| n.checked_mul(side));
        if bytes.is_none_or(|bytes| bytes > MOST_CHUNK_BYTES) {
            return Err(Problem::unsupported(format!(
                "chunks of {:?} numbers of {size} bytes",
                self.chunk
            )));
        }
        Ok(self)
    }
}

fn names_of(value: &Value, num_axes: usize) -> Option<Vec<String>> {
    let names = value.as_array().filter(|all| all.len() == num_axes)?;
    let name = |v: &Value| v.as_str().map(str::to_lowercase);
    names.iter().map(name).collect()
}

/// `<f4` and the like, as NumPy writes them.
fn type_of_version_2(value: &Value) -> Result<(Stored, Endianness), Problem> {
    let unsupported = || Problem::unsupported(format!("numbers of type {value}"));
    let text = value.as_str().ok_or_else(unsupported)?;
    let mut letters = text.chars();
    let endianness = match letters.next() {
        Some('<') => Endianness::Little,
        Some('>') => Endianness::Big,
        Some('|') => Endianness::NATIVE,
        _ => return Err(unsupported()),
    };
    let stored = match letters.as_str() {
        "b1" | "u1" => Stored::Same(ScalarType::U8),
        "i1" => Stored::Same(ScalarType::I8),
        "u2" => Stored::Same(ScalarType::U16),
        "i2" => Stored::Same(ScalarType::I16),
        "u4" => Stored::Same(ScalarType::U32),
        "i4" => Stored::Same(ScalarType::I32),
        "u8" => Stored::Same(ScalarType::U64),
        "i8" => Stored::Same(ScalarType::I64),
        "f2" => Stored::Half,
        "f4" => Stored::Same(ScalarType::F32),
        "f8" => Stored::Same(ScalarType::F64),
        _ => return Err(unsupported()),
    };
    Ok((stored, endianness))
}

fn type_of_version_3(value: &Value) -> Result<Stored, Problem> {
    let scalar_type = match value.as_str() {
        Some("bool" | "uint8") => ScalarType::U8,
        Some("int8") => ScalarType::I8,
        Some("uint16") => ScalarType::U16,
        Some("int16") => ScalarType::I16,
        Some("uint32") => ScalarType::U32,
        Some("int32") => ScalarType::I32,
        Some("uint64") => ScalarType::U64,
        Some("int64") => ScalarType::I64,
        Some("float16") => return Ok(Stored::Half),
        Some("float32") => ScalarType::F32,
        Some("float64") => ScalarType::F64,
        _ => return Err(Problem::unsupported(format!("numbers of type {value}"))),
    };
    Ok(Stored::Same(scalar_type))
}

/// The value of what is not stored, in native bytes; 0 if there is none.
fn fill(stored: Stored, value: &Value) -> Result<Vec<u8>, Problem> {
    let unlike = || wrong("fill_value", "a number of the array's type", value);
    // The bits of a float.
    if let Some(digits) = value.as_str().and_then(|text| text.strip_prefix("0x")) {
        let bits = u64::from_str_radix(digits, 16).map_err(|_| unlike())?;
        return match stored {
            Stored::Half => u16::try_from(bits).map(|b| b.to_ne_bytes().to_vec()).ok(),
            Stored::Same(ScalarType::F32) => {
                u32::try_from(bits).map(|b| b.to_ne_bytes().to_vec()).ok()
            }
            Stored::Same(ScalarType::F64) => Some(bits.to_ne_bytes().to_vec()),
            Stored::Same(_) => None,
        }
        .ok_or_else(unlike);
    }
    let float = || match value {
        Value::Null => Some(0.0),
        Value::String(text) => match text.as_str() {
            "NaN" => Some(f64::NAN),
            "Infinity" => Some(f64::INFINITY),
            "-Infinity" => Some(f64::NEG_INFINITY),
            _ => None,
        },
        other => other.as_f64(),
    };
    let integer = || match value {
        Value::Null | Value::Bool(false) => Some(0),
        Value::Bool(true) => Some(1),
        Value::Number(number) => number.as_i128().or_else(|| {
            let float = number.as_f64()?;
            (float.fract() == 0.0).then_some(float as i128)
        }),
        _ => None,
    };
    macro_rules! bytes_of {
        ($type:ty) => {
            integer()
                .and_then(|n| <$type>::try_from(n).ok())
                .map(|n| n.to_ne_bytes().to_vec())
        };
    }
    match stored {
        Stored::Half => float().map(|f| half::f16::from_f64(f).to_ne_bytes().to_vec()),
        Stored::Same(scalar_type) => match scalar_type {
            ScalarType::U8 => bytes_of!(u8),
            ScalarType::I8 => bytes_of!(i8),
            ScalarType::U16 => bytes_of!(u16),
            ScalarType::I16 => bytes_of!(i16),
            ScalarType::U32 => bytes_of!(u32),
            ScalarType::I32 => bytes_of!(i32),
            ScalarType::U64 => bytes_of!(u64),
            ScalarType::I64 => bytes_of!(i64),
            ScalarType::F32 => float().map(|f| (f as f32).to_ne_bytes().to_vec()),
            ScalarType::F64 => float().map(|f| f.to_ne_bytes().to_vec()),
        },
    }
    .ok_or_else(unlike)
}

/// Name and configuration of a codec.
fn codec(value: &Value) -> Result<(&str, &Value), Problem> {
    let name = value["name"].as_str().or_else(|| value.as_str());
    let name = name.ok_or_else(|| wrong("codecs", "codecs with names", value))?;
    Ok((name, &value["configuration"]))
}

fn endianness(configuration: &Value) -> Result<Endianness, Problem> {
    match configuration["endian"].as_str() {
        None => Ok(Endianness::NATIVE),
        Some("little") => Ok(Endianness::Little),
        Some("big") => Ok(Endianness::Big),
        Some(_) => Err(wrong(
            "endian",
            "`little` or `big`",
            &configuration["endian"],
        )),
    }
}

/// The codecs of chunks, which may lie in shards: then the files are these.
fn codecs_and_shards(
    codecs: &Value,
    of_files: Vec<usize>,
) -> Result<(Vec<usize>, Codecs, Option<Shards>), Problem> {
    let all = codecs.as_array().filter(|all| !all.is_empty());
    let all = all.ok_or_else(|| wrong("codecs", "at least one", codecs))?;
    let (name, configuration) = codec(&all[0])?;
    if name != "sharding_indexed" {
        let codecs = Codecs::of(all, of_files.len())?;
        return Ok((of_files, codecs, None));
    }
    if all.len() > 1 {
        return Err(Problem::unsupported("shards that are packed as a whole"));
    }
    let place = "chunk_shape of shards";
    let chunk = chunk_sizes(place, &configuration["chunk_shape"], of_files.len())?;
    let divides = |(whole, part): (&usize, &usize)| whole.is_multiple_of(*part);
    if !of_files.iter().zip(&chunk).all(divides) {
        let found = &configuration["chunk_shape"];
        return Err(wrong(place, &format!("divisors of {of_files:?}"), found));
    }
    let inner = configuration["codecs"].as_array();
    let inner = inner.ok_or_else(|| wrong("codecs of shards", "codecs", configuration))?;
    let of_index = configuration["index_codecs"].as_array();
    let of_index = of_index.ok_or_else(|| wrong("index_codecs", "codecs", configuration))?;
    let of_index = Codecs::of(of_index, 1)?;
    if of_index
        .packing
        .iter()
        .any(|&method| method != Packing::Crc32c)
    {
        return Err(Problem::unsupported(
            "an index of shards that is compressed",
        ));
    }
    let index_is_last = match configuration["index_location"].as_str() {
        None | Some("end") => true,
        Some("start") => false,
        Some(_) => {
            let found = &configuration["index_location"];
            return Err(wrong("index_location", "`start` or `end`", found));
        }
    };
    let codecs = Codecs::of(inner, of_files.len())?;
    let shards = Shards {
        shape: of_files,
        index_is_last,
        index_endianness: of_index.endianness,
        index_packing: of_index.packing,
    };
    Ok((chunk, codecs, Some(shards)))
}

impl Codecs {
    /// Reads a list of codecs: of arrays, then the one that makes bytes, then those of bytes.
    fn of(all: &[Value], num_axes: usize) -> Result<Self, Problem> {
        let mut order: Vec<usize> = (0..num_axes).collect();
        let mut packing = Vec::new();
        let mut made_bytes = None;
        for value in all {
            let (name, configuration) = codec(value)?;
            match (name, made_bytes) {
                ("bytes", None) => made_bytes = Some(endianness(configuration)?),
                ("transpose", None) => {
                    let turn = &configuration["order"];
                    order = permuted(&order, turn)
                        .ok_or_else(|| wrong("order", "each axis once", turn))?;
                }
                ("sharding_indexed", _) => {
                    return Err(Problem::unsupported(
                        "shards in shards, or in another order",
                    ));
                }
                (name, Some(_)) => packing.push(Packing::of_name(name, configuration)?),
                (name, None) => {
                    return Err(Problem::unsupported(format!(
                        "the codec `{name}` of arrays"
                    )));
                }
            }
        }
        let endianness = made_bytes.ok_or_else(|| {
            Problem::malformed("`codecs`", "one that makes bytes", "none of that kind")
        })?;
        Ok(Self {
            order,
            endianness,
            packing,
        })
    }
}

/// The axes in another order: the first is the one that `turn` begins with …
fn permuted(axes: &[usize], turn: &Value) -> Option<Vec<usize>> {
    let turn = turn.as_array().filter(|turn| turn.len() == axes.len())?;
    let axis = |v: &Value| axes.get(usize::try_from(v.as_u64()?).ok()?).copied();
    let turned: Vec<usize> = turn.iter().map(axis).collect::<Option<_>>()?;
    axes.iter()
        .all(|axis| turned.contains(axis))
        .then_some(turned)
}
