-- Wireshark dissector of both datagrams of the Xerxes mount control protocol.
--
-- For Wireshark 3.6 and later, 4.x included (Lua 5.2 to 5.4). Copy it into the folder that Help > About Wireshark >
-- Folders names "Personal Lua Plugins", or give it as `tshark -X lua_script:xerxes.lua`. The protocol is told in
-- docs/xerxes-protocol.md.
--
-- Datagrams are known by length and header on any port. On the ports of the preference, those with a wrong header
-- or length are shown too, as errors.

-- BEGIN fields: written by `python -m tools.protocol`
local COMMAND_HEADER = "\170\170\085\085\000\000\000\000"
local STATUS_HEADER = "\088\069\082\088\069\083\120\120"
local COMMAND_LENGTH = 82
local STATUS_LENGTH = 160
local DTICS_S_PER_DEG_S = 1864135.1111111112
local COMMAND_FIELDS = {
  { offset = 0, length = 8, name = "header", kind = "uint64", unit = "", meaning = "0x5555AAAA, upper half zero" },
  { offset = 8, length = 8, name = "counter", kind = "int64", unit = "", meaning = "rolling counter of commands sent" },
  { offset = 16, length = 8, name = "target_dec_deg", kind = "double", unit = "deg", meaning = "target of a slew or sync, degrees, JNow" },
  { offset = 24, length = 8, name = "target_ra_h", kind = "double", unit = "h", meaning = "target of a slew or sync, hours 0 to 24, JNow" },
  { offset = 32, length = 8, name = "move_dec_rate_deg_s", kind = "double", unit = "deg_s", meaning = "MoveAxis rate, declination" },
  { offset = 40, length = 8, name = "move_ra_rate_deg_s", kind = "double", unit = "deg_s", meaning = "MoveAxis rate, right ascension axis" },
  { offset = 48, length = 8, name = "dec_fine_rate_dtics_s", kind = "int64", unit = "dtics_s", meaning = "fine rate, encoder tics per second x 10" },
  { offset = 56, length = 8, name = "ra_fine_rate_dtics_s", kind = "int64", unit = "dtics_s", meaning = "fine rate, encoder tics per second x 10" },
  { offset = 64, length = 4, name = "pulse_ra_ms", kind = "int32", unit = "ms", meaning = "pulse guide duration, negative is east" },
  { offset = 68, length = 4, name = "pulse_dec_ms", kind = "int32", unit = "ms", meaning = "pulse guide duration, the sign is the direction" },
  { offset = 72, length = 1, name = "tracking_rate", kind = "byte", unit = "", meaning = "0 to 3, not used by the mount" },
  { offset = 73, length = 1, name = "abort", kind = "flag", unit = "", meaning = "slow down, stop, keep the drives active" },
  { offset = 74, length = 1, name = "find_home", kind = "flag", unit = "", meaning = "move to the home position, not used by the mount" },
  { offset = 75, length = 1, name = "move_ra", kind = "flag", unit = "", meaning = "MoveAxis on the right ascension axis" },
  { offset = 76, length = 1, name = "move_dec", kind = "flag", unit = "", meaning = "MoveAxis on the declination axis" },
  { offset = 77, length = 1, name = "park", kind = "flag", unit = "", meaning = "disable the drives wherever the mount is" },
  { offset = 78, length = 1, name = "pulse_guide", kind = "flag", unit = "", meaning = "start the pulse guide timers of both axes" },
  { offset = 79, length = 1, name = "slew", kind = "flag", unit = "", meaning = "slew to the target, ignored while slewing" },
  { offset = 80, length = 1, name = "sync", kind = "flag", unit = "", meaning = "report the target as the present position" },
  { offset = 81, length = 1, name = "spare", kind = "flag", unit = "", meaning = "unused" },
}
local STATUS_FIELDS = {
  { offset = 0, length = 8, name = "header", kind = "header", unit = "", meaning = "XERXESxx" },
  { offset = 8, length = 8, name = "altitude_deg", kind = "double", unit = "deg", meaning = "altitude" },
  { offset = 16, length = 8, name = "azimuth_deg", kind = "double", unit = "deg", meaning = "azimuth; the paper's row says elevation" },
  { offset = 24, length = 8, name = "dec_deg", kind = "double", unit = "deg", meaning = "declination, JNow" },
  { offset = 32, length = 8, name = "dec_rate_dtics_s", kind = "either", unit = "dtics_s", meaning = "declination drive rate, tics per second x 10" },
  { offset = 40, length = 8, name = "ra_h", kind = "double", unit = "h", meaning = "right ascension, hours, JNow" },
  { offset = 48, length = 8, name = "ra_rate_dtics_s", kind = "either", unit = "dtics_s", meaning = "right ascension drive rate; sidereal is 7789" },
  { offset = 56, length = 8, name = "sidereal_h", kind = "double", unit = "h", meaning = "local sidereal time of the mount's own clock, hours" },
  { offset = 64, length = 8, name = "site_height_m", kind = "double", unit = "m", meaning = "site elevation" },
  { offset = 72, length = 8, name = "site_latitude_deg", kind = "double", unit = "deg", meaning = "site latitude" },
  { offset = 80, length = 8, name = "site_longitude_deg", kind = "double", unit = "deg", meaning = "site longitude" },
  { offset = 88, length = 8, name = "target_dec_deg", kind = "double", unit = "deg", meaning = "target of the last slew or sync" },
  { offset = 96, length = 8, name = "target_ra_h", kind = "double", unit = "h", meaning = "target of the last slew or sync, hours" },
  { offset = 104, length = 8, name = "counter", kind = "either", unit = "", meaning = "rolling counter, one a status datagram" },
  { offset = 112, length = 8, name = "dec_guide_rate_dtics_s", kind = "either", unit = "dtics_s", meaning = "guide rate, about 3500" },
  { offset = 120, length = 8, name = "ra_guide_rate_dtics_s", kind = "either", unit = "dtics_s", meaning = "guide rate, about 3500" },
  { offset = 128, length = 4, name = "dec_current_10ma", kind = "int32", unit = "10ma", meaning = "declination drive current, 10 mA" },
  { offset = 132, length = 4, name = "ra_current_10ma", kind = "int32", unit = "10ma", meaning = "right ascension drive current, 10 mA" },
  { offset = 136, length = 1, name = "at_home", kind = "flag", unit = "", meaning = "at home, packed as 0" },
  { offset = 137, length = 1, name = "at_park", kind = "flag", unit = "", meaning = "at park, packed as 0" },
  { offset = 138, length = 1, name = "connected", kind = "flag", unit = "", meaning = "always true" },
  { offset = 139, length = 1, name = "does_refraction", kind = "flag", unit = "", meaning = "the mount applies refraction itself" },
  { offset = 140, length = 1, name = "equatorial_system", kind = "byte", unit = "", meaning = "0: JNow" },
  { offset = 141, length = 1, name = "pulse_guiding", kind = "flag", unit = "", meaning = "either pulse guide timer runs" },
  { offset = 142, length = 1, name = "side_of_pier", kind = "flag", unit = "", meaning = "beyond the pole" },
  { offset = 143, length = 1, name = "slewing", kind = "flag", unit = "", meaning = "slewing, or MoveAxis in force" },
  { offset = 144, length = 1, name = "tracking", kind = "flag", unit = "", meaning = "always true by the table, not slewing by the code" },
  { offset = 145, length = 1, name = "tracking_rate", kind = "byte", unit = "", meaning = "0: sidereal" },
  { offset = 146, length = 1, name = "ack_move_dec", kind = "flag", unit = "", meaning = "MoveAxis in declination acknowledged" },
  { offset = 147, length = 1, name = "ack_move_ra", kind = "flag", unit = "", meaning = "MoveAxis in right ascension acknowledged" },
  { offset = 148, length = 1, name = "utc_1", kind = "byte", unit = "", meaning = "future" },
  { offset = 149, length = 1, name = "utc_2", kind = "byte", unit = "", meaning = "future" },
  { offset = 150, length = 1, name = "utc_3", kind = "byte", unit = "", meaning = "future" },
  { offset = 151, length = 1, name = "ra_drive_status_1", kind = "byte", unit = "", meaning = "future" },
  { offset = 152, length = 1, name = "ra_drive_status_2", kind = "byte", unit = "", meaning = "future" },
  { offset = 153, length = 1, name = "dec_drive_status_1", kind = "byte", unit = "", meaning = "future" },
  { offset = 154, length = 1, name = "dec_drive_status_2", kind = "byte", unit = "", meaning = "future" },
  { offset = 155, length = 1, name = "ack_abort", kind = "flag", unit = "", meaning = "abort acknowledged" },
  { offset = 156, length = 1, name = "ack_sync", kind = "flag", unit = "", meaning = "sync acknowledged" },
  { offset = 157, length = 1, name = "ack_pulse_guide", kind = "flag", unit = "", meaning = "pulse guide acknowledged" },
  { offset = 158, length = 1, name = "ack_slew", kind = "flag", unit = "", meaning = "slew acknowledged" },
  { offset = 159, length = 1, name = "spare", kind = "byte", unit = "", meaning = "unused" },
}
-- END fields

local ACK_OF = "ack_"
local LATE_AT_MOST = 400 -- a counter further back than this has begun anew
local TWO_32 = 4294967296.0

-- Units that are shown a second time in another: suffix, its replacement, factor.
local ALSO = {
  h = { suffix = "_h", replacement = "_deg", factor = 15.0 },
  dtics_s = { suffix = "_dtics_s", replacement = "_deg_s", factor = 1.0 / DTICS_S_PER_DEG_S },
  ["10ma"] = { suffix = "_10ma", replacement = "_a", factor = 0.01 },
}

local RANGES = {
  target_dec_deg = { -90.0, 90.0 },
  target_ra_h = { 0.0, 24.0 },
  altitude_deg = { -90.0, 90.0 },
  azimuth_deg = { 0.0, 360.0 },
  dec_deg = { -90.0, 90.0 },
  ra_h = { 0.0, 24.0 },
  sidereal_h = { 0.0, 24.0 },
  site_latitude_deg = { -90.0, 90.0 },
}

local xerxes = Proto("xerxes", "Xerxes Mount Control Protocol")

xerxes.prefs.ports =
  Pref.range("UDP ports", "15001", "Ports on which datagrams with a wrong header or length are shown too", 65535)

local e_header =
  ProtoExpert.new("xerxes.expert.header", "Wrong header", expert.group.PROTOCOL, expert.severity.ERROR)
local e_length =
  ProtoExpert.new("xerxes.expert.length", "Wrong length", expert.group.MALFORMED, expert.severity.ERROR)
local e_number = ProtoExpert.new("xerxes.expert.number", "Not a number", expert.group.PROTOCOL, expert.severity.ERROR)
local e_range = ProtoExpert.new("xerxes.expert.range", "Out of range", expert.group.PROTOCOL, expert.severity.WARN)
local e_flags =
  ProtoExpert.new("xerxes.expert.flags", "Several requests at once", expert.group.PROTOCOL, expert.severity.WARN)
local e_byte = ProtoExpert.new("xerxes.expert.flag", "True that is not 0xFF", expert.group.PROTOCOL, expert.severity.NOTE)
local e_order = ProtoExpert.new("xerxes.expert.order", "Order of counters", expert.group.SEQUENCE, expert.severity.NOTE)
local e_edge =
  ProtoExpert.new("xerxes.expert.edge", "Accidental rising edge", expert.group.SEQUENCE, expert.severity.WARN)
local e_ack = ProtoExpert.new(
  "xerxes.expert.ack",
  "Acknowledgement without a new request",
  expert.group.SEQUENCE,
  expert.severity.WARN
)
local e_stale =
  ProtoExpert.new("xerxes.expert.stale", "Stale: not slewing yet", expert.group.SEQUENCE, expert.severity.NOTE)
local e_sender =
  ProtoExpert.new("xerxes.expert.sender", "Second sender", expert.group.SECURITY, expert.severity.WARN)
xerxes.experts =
  { e_header, e_length, e_number, e_range, e_flags, e_byte, e_order, e_edge, e_ack, e_stale, e_sender }

local f_rises = ProtoField.string("xerxes.command.rises", "Rising edges")
local f_acked_in = ProtoField.framenum("xerxes.command.acknowledged_in", "Acknowledged in", base.NONE)
local f_request_in = ProtoField.framenum("xerxes.status.request_in", "Acknowledges the request that rose in", base.NONE)
local f_ack_after = ProtoField.double("xerxes.status.acknowledged_after_s", "acknowledged_after_s")
local all_fields = { f_rises, f_acked_in, f_request_in, f_ack_after }

local function make_field(abbreviation, row)
  local kind, name, meaning = row.kind, row.name, row.meaning
  if kind == "uint64" then
    return ProtoField.uint64(abbreviation, name, base.HEX, nil, nil, meaning)
  elseif kind == "int64" then
    return ProtoField.int64(abbreviation, name, base.DEC, nil, nil, meaning)
  elseif kind == "int32" then
    return ProtoField.int32(abbreviation, name, base.DEC, nil, nil, meaning)
  elseif kind == "byte" then
    return ProtoField.uint8(abbreviation, name, base.DEC, nil, nil, meaning)
  elseif kind == "flag" then
    return ProtoField.bool(abbreviation, name, base.NONE, nil, nil, meaning)
  elseif kind == "header" then
    return ProtoField.string(abbreviation, name, base.ASCII, meaning)
  end
  return ProtoField.double(abbreviation, name, meaning)
end

local function make_fields(prefix, rows)
  for _, row in ipairs(rows) do
    row.field = make_field(prefix .. row.name, row)
    all_fields[#all_fields + 1] = row.field
    local also = ALSO[row.unit]
    if also then
      local name = row.name:sub(1, #row.name - #also.suffix) .. also.replacement
      row.also = { field = ProtoField.double(prefix .. name, name, row.meaning), factor = also.factor }
      all_fields[#all_fields + 1] = row.also.field
    end
    if row.kind == "either" then
      local name = row.name .. ".reading"
      row.reading_field = ProtoField.string(prefix .. name, row.name .. " read as")
      all_fields[#all_fields + 1] = row.reading_field
    end
  end
end

make_fields("xerxes.command.", COMMAND_FIELDS)
make_fields("xerxes.status.", STATUS_FIELDS)
xerxes.fields = all_fields

local function is_finite(number)
  return number == number and number > -math.huge and number < math.huge
end

-- The rule of `reading_of` in sattrack/mount/xerxes/datagrams.py: as an int64, a double of ordinary size is huge.
local function read_either(range)
  local low, high = range(0, 4):le_uint(), range(4, 4):le_uint()
  if low == 0 and high == 0 then
    return 0.0, "zero: int64 and double alike"
  elseif high < 0x200000 then
    return high * TWO_32 + low, "int64"
  elseif high > 0xFFE00000 or (high == 0xFFE00000 and low > 0) then
    return (high - TWO_32) * TWO_32 + low, "int64"
  end
  return range:le_float(), "double"
end

local function read_value(row, range)
  local kind = row.kind
  if kind == "double" then
    return range:le_float()
  elseif kind == "either" then
    return read_either(range)
  elseif kind == "int64" then
    return range:le_int64():tonumber()
  elseif kind == "int32" then
    return range:le_int()
  elseif kind == "byte" then
    return range:uint()
  elseif kind == "flag" then
    return range:uint() ~= 0
  end
  return nil
end

local function check_value(item, row, range, value)
  if row.kind == "flag" then
    local byte = range:uint()
    if byte ~= 0 and byte ~= 0xFF then
      item:add_proto_expert_info(e_byte, string.format("%s is 0x%02X; taken as true", row.name, byte))
    end
  elseif row.kind == "double" or row.kind == "either" then
    local bounds = RANGES[row.name]
    if not is_finite(value) then
      item:add_proto_expert_info(e_number, row.name .. " is not a finite number")
    elseif bounds and not (value >= bounds[1] and value <= bounds[2]) then
      local words = "%s is %g; it runs from %g to %g"
      item:add_proto_expert_info(e_range, words:format(row.name, value, bounds[1], bounds[2]))
    end
  end
end

local function add_row(tree, row, buffer)
  local range = buffer(row.offset, row.length)
  local value, reading = read_value(row, range)
  local item
  if row.kind == "either" then
    item = tree:add(row.field, range, value)
    item:append_text(" (" .. reading .. ")")
    item:add(row.reading_field, range, reading):set_generated()
  else
    item = tree:add_le(row.field, range)
  end
  if row.also then
    item:add(row.also.field, range, value * row.also.factor):set_generated()
  end
  check_value(item, row, range, value)
  return value, item
end

local function add_rows(tree, rows, buffer)
  local values, items = {}, {}
  for _, row in ipairs(rows) do
    values[row.name], items[row.name] = add_row(tree, row, buffer)
  end
  return values, items
end

-- What frames say of each other. Filled at the first pass, in the order of arrival, and only read afterwards.
local frames, pairs_seen, streams, senders

function xerxes.init()
  frames, pairs_seen, streams, senders = {}, {}, {}, {}
end

local function ends_of(pinfo)
  return tostring(pinfo.src), tostring(pinfo.dst)
end

-- Both directions between one client and one mount. Hosts tell them apart, as a mount may send from another port
-- than it listens on; on one host alone only ports do.
local function pair_of(pinfo)
  local a, b = ends_of(pinfo)
  if a == b then
    a, b = a .. ":" .. pinfo.src_port, b .. ":" .. pinfo.dst_port
  end
  local key = a < b and a .. " " .. b or b .. " " .. a
  pairs_seen[key] = pairs_seen[key] or { requests = {}, flags = {}, acks = {} }
  return pairs_seen[key]
end

local function judge_order(pinfo, counter)
  local src, dst = ends_of(pinfo)
  local key = src .. ":" .. pinfo.src_port .. ">" .. dst .. ":" .. pinfo.dst_port
  local highest = streams[key]
  if highest == nil or not is_finite(counter) then
    streams[key] = highest or counter
    return nil
  end
  local ahead = counter - highest
  if ahead > 0 or ahead < -LATE_AT_MOST then
    streams[key] = counter
  end
  if ahead == 0 then
    return { kind = "duplicate", words = "the counter repeats: a duplicate" }
  elseif ahead < -LATE_AT_MOST then
    return { kind = "restart", words = "the counter begins anew" }
  elseif ahead < 0 then
    return { kind = "late", words = string.format("the counter goes back by %.0f: a late datagram", -ahead) }
  elseif ahead > 1 then
    return { kind = "gap", words = string.format("%.0f datagrams before this one are missing", ahead - 1) }
  end
  return nil
end

local function follow_command(pinfo, values)
  local pair, note = pair_of(pinfo), { rises = {}, falls = {} }
  note.order = judge_order(pinfo, values.counter)
  for _, row in ipairs(COMMAND_FIELDS) do
    if row.kind == "flag" then
      local name, up = row.name, values[row.name]
      if up and not pair.flags[name] then
        note.rises[#note.rises + 1] = name
        pair.requests[name] = { frame = pinfo.number, at_s = pinfo.rel_ts, acked_in = nil }
      elseif pair.flags[name] and not up then
        note.falls[#note.falls + 1] = name
      end
      pair.flags[name] = up
    end
  end
  note.requests = {}
  for _, name in ipairs(note.rises) do
    note.requests[#note.requests + 1] = pair.requests[name]
  end
  local src, dst = ends_of(pinfo)
  local mount, sender = dst .. ":" .. pinfo.dst_port, src .. ":" .. pinfo.src_port
  note.other_sender = senders[mount] ~= sender and senders[mount] or nil
  senders[mount] = sender
  return note
end

local function follow_status(pinfo, values)
  local pair, note = pair_of(pinfo), { answers = {}, odd = {} }
  note.order = judge_order(pinfo, values.counter)
  local late = note.order and (note.order.kind == "late" or note.order.kind == "duplicate")
  for _, row in ipairs(STATUS_FIELDS) do
    if row.name:sub(1, #ACK_OF) == ACK_OF then
      local name, up = row.name:sub(#ACK_OF + 1), values[row.name]
      local request = pair.requests[name]
      if up and not pair.acks[name] and not late then
        if request == nil then
          note.odd[row.name] = "no request in this capture: from before its beginning, or another sender's"
        elseif request.acked_in then
          note.odd[row.name] = "acknowledged a second time: a late or repeated datagram made a second rising edge"
        else
          request.acked_in = pinfo.number
          note.answers[row.name] = { frame = request.frame, after_s = pinfo.rel_ts - request.at_s }
        end
      elseif up and request then
        note.answers[row.name] = { frame = request.frame }
      end
      if not late then
        pair.acks[name] = up
      end
    end
  end
  local slew = pair.requests.slew
  if slew and pair.flags.slew and not slew.acked_in and not values.slewing then
    note.stale = string.format("the slew of frame %d is not acknowledged yet: this is not its end", slew.frame)
  end
  return note
end

local function note_of(pinfo, values, follow, accepted)
  if not accepted then
    -- Neither end takes it, so nothing follows from it.
    return { rises = {}, falls = {}, requests = {}, answers = {}, odd = {} }
  end
  if not frames[pinfo.number] then
    frames[pinfo.number] = follow(pinfo, values)
  end
  return frames[pinfo.number]
end

local function flags_up(values)
  local names, requests = {}, 0
  for _, row in ipairs(COMMAND_FIELDS) do
    if row.kind == "flag" and row.name ~= "spare" and values[row.name] then
      names[#names + 1] = row.name
      -- Both flags of MoveAxis are one request.
      if not (row.name == "move_dec" and values.move_ra) then
        requests = requests + 1
      end
    end
  end
  return names, requests
end

local function show_command(buffer, pinfo, tree)
  local values, items = add_rows(tree, COMMAND_FIELDS, buffer)
  local accepted = buffer(0, 8):raw() == COMMAND_HEADER
  if not accepted then
    items.header:add_proto_expert_info(e_header, "a command begins with AA AA 55 55 00 00 00 00")
  end
  local names, requests = flags_up(values)
  if requests > 1 then
    tree:add_proto_expert_info(e_flags, table.concat(names, ", ") .. ": the mount serves one, by its priorities")
  end
  local note = note_of(pinfo, values, follow_command, accepted)
  if note.order then
    items.counter:add_proto_expert_info(e_order, note.order.words)
    local accident = note.order.kind == "late" or note.order.kind == "duplicate"
    if accident and #note.rises > 0 then
      tree:add_proto_expert_info(e_edge, table.concat(note.rises, ", ") .. ": a late datagram raises it again")
    elseif accident and #note.falls > 0 then
      local words = ": a late datagram takes it down, and the next may raise it again"
      tree:add_proto_expert_info(e_edge, table.concat(note.falls, ", ") .. words)
    end
  end
  if note.other_sender then
    tree:add_proto_expert_info(e_sender, "commands to this mount came from " .. note.other_sender .. " before")
  end
  if #note.rises > 0 then
    tree:add(f_rises, table.concat(note.rises, " ")):set_generated()
  end
  for _, request in ipairs(note.requests) do
    if request.acked_in then
      tree:add(f_acked_in, request.acked_in):set_generated()
    end
  end
  local words = { string.format("Command %.0f", values.counter) }
  for _, name in ipairs(names) do
    words[#words + 1] = name
  end
  if values.slew or values.sync then
    words[#words + 1] = string.format("to RA %.5f h, Dec %+.4f deg", values.target_ra_h, values.target_dec_deg)
  end
  if values.move_ra then
    words[#words + 1] = string.format("RA %+.6f deg/s", values.move_ra_rate_deg_s)
  end
  if values.move_dec then
    words[#words + 1] = string.format("Dec %+.6f deg/s", values.move_dec_rate_deg_s)
  end
  if values.pulse_guide then
    words[#words + 1] = string.format("RA %d ms, Dec %d ms", values.pulse_ra_ms, values.pulse_dec_ms)
  end
  pinfo.cols.info = table.concat(words, " ")
end

local function show_status(buffer, pinfo, tree)
  local values, items = add_rows(tree, STATUS_FIELDS, buffer)
  local accepted = buffer(0, 8):raw() == STATUS_HEADER
  if not accepted then
    items.header:add_proto_expert_info(e_header, "a status begins with XERXESxx")
  end
  local note = note_of(pinfo, values, follow_status, accepted)
  if note.order then
    items.counter:add_proto_expert_info(e_order, note.order.words)
  end
  if note.stale then
    items.slewing:add_proto_expert_info(e_stale, note.stale)
  end
  local words = {
    string.format("Status %.0f RA %.5f h, Dec %+.4f deg", values.counter, values.ra_h, values.dec_deg),
  }
  for _, name in ipairs({ "slewing", "pulse_guiding", "at_home", "at_park" }) do
    if values[name] then
      words[#words + 1] = name
    end
  end
  for _, row in ipairs(STATUS_FIELDS) do
    local answer, odd = note.answers[row.name], note.odd[row.name]
    if answer then
      items[row.name]:add(f_request_in, answer.frame):set_generated()
      if answer.after_s then
        items[row.name]:add(f_ack_after, answer.after_s):set_generated()
      end
    elseif odd then
      items[row.name]:add_proto_expert_info(e_ack, odd)
    end
    if row.name:sub(1, #ACK_OF) == ACK_OF and values[row.name] then
      words[#words + 1] = row.name
    end
  end
  pinfo.cols.info = table.concat(words, " ")
end

local function header_kind(buffer)
  if buffer:len() < 8 then
    return nil
  end
  local header = buffer(0, 8):raw()
  return header == COMMAND_HEADER and "command" or header == STATUS_HEADER and "status" or nil
end

function xerxes.dissector(buffer, pinfo, tree)
  local length, kind = buffer:reported_len(), header_kind(buffer)
  if not kind and length ~= COMMAND_LENGTH and length ~= STATUS_LENGTH then
    return 0
  end
  pinfo.cols.protocol = "XERXES"
  local subtree = tree:add(xerxes, buffer())
  local wanted = kind == "command" and COMMAND_LENGTH or kind == "status" and STATUS_LENGTH or length
  if length ~= wanted then
    local words = string.format("a %s has %d bytes, this one %d", kind, wanted, length)
    subtree:add_proto_expert_info(e_length, words)
    pinfo.cols.info = "Wrong length: " .. words
  elseif buffer:len() < length then
    subtree:append_text(", cut short by the capture")
    pinfo.cols.info = "Cut short by the capture"
  elseif length == COMMAND_LENGTH then
    subtree:append_text(", command")
    show_command(buffer, pinfo, subtree)
  else
    subtree:append_text(", status")
    show_status(buffer, pinfo, subtree)
  end
  return buffer:len()
end

xerxes:register_heuristic("udp", function(buffer, pinfo, tree)
  local kind, length = header_kind(buffer), buffer:reported_len()
  local ours = (kind == "command" and length == COMMAND_LENGTH) or (kind == "status" and length == STATUS_LENGTH)
  if ours then
    xerxes.dissector(buffer, pinfo, tree)
  end
  return ours
end)

local udp_ports = DissectorTable.get("udp.port")
local ports = xerxes.prefs.ports
udp_ports:add(ports, xerxes)

function xerxes.prefs_changed()
  if xerxes.prefs.ports ~= ports then
    udp_ports:remove(ports, xerxes)
    ports = xerxes.prefs.ports
    udp_ports:add(ports, xerxes)
  end
end
