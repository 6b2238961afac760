"""Logs as loggers, boards and consoles write them: names, units, rate and values are the right ones."""

import json
import math
from functools import reduce

import numpy as np
import pytest

from kalscope.errors import BadFile
from kalscope.sources.reading.recording_file import read_recording

N = 40
A = [round(20 + 3 * math.sin(i / 9), 2) for i in range(N)]
B = [round(1012.5 + 0.31 * (i * 7 % N), 2) for i in range(N)]

DAYS = ("Fri", "Sat", "Sun", "Mon", "Tue", "Wed", "Thu")
T = np.cumsum(np.random.default_rng(1).integers(2, 60, N))
CHANGES = np.cumsum([(1.2e-6, 3.1e-4, 2.1e-3, 0.7, 8e-6, 0.05)[i * i % 37 % 6] for i in range(N)])


def german(value):
    return f"{value:,.2f}".translate(str.maketrans(".,", ",."))


def rows(line):
    return "".join(line(i) for i in range(N))


def clock(i, step=10):
    seconds = int(i * step)
    return f"{9 + seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}"


def davis(i):
    hour, half = divmod(i % 48, 2)
    return f"{(hour + 11) % 12 + 1}:{30 * half:02} {'ap'[hour >= 12]}"


def nmea(sentence):
    return f"${sentence}*{reduce(int.__xor__, sentence.encode()):02X}\n"


def log(right, *content):
    """A log, its period, s, and its channels; right: "10 s, Temp [°C] = A; hum = B", content: texts and rows."""
    values, found = {"A": A, "B": B, "A, NaN": [*A, math.nan]}, {}
    period, _, channels = right.partition(", ")
    for name, _, letter in (channel.rpartition(" = ") for channel in channels.split("; ")):
        found[tuple(name.removesuffix("]").partition(" [")[::2])] = values[letter]
    text = "".join(part if isinstance(part, str) else rows(lambda i, row=part: row(i) + "\n") for part in content)
    return text, None if period == "no rate" else float(period[:-2]), found


LOGS = {
    "tuples, and blanks": log("0.1 s, value 1 = A; value 2 = B", lambda i: f" ({i / 10:.1f}, {A[i]}, {B[i]} )"),
    "a dict of Python": log("0.05 s, temp = A", lambda i: f"{{'ms': {50 * i}, 'temp': {A[i]}, 'ok': True}}"),
    "date_time of a shell": log("10 s, temp = A", lambda i: f"2024-03-05_{clock(i)} temp={A[i]}"),
    "Klipper": log("1 s, bed: temp = A; bed: pwm = B; nozzle: temp = A; nozzle: pwm = B",
        lambda i: f"Stats {812.4 + i:.1f}: bed: temp={A[i]} pwm={B[i]} nozzle: temp={A[i]} pwm={B[i]}"),
    "RFC 5424": log("10 s, temp = A", lambda i: f"<134>1 2024-05-17T{clock(i)}Z pi app 412 - - temp={A[i]}"),
    "Rigol, with an increment": log("1e-05 s, CH1 = A", "X,CH1,Start,Increment\nSequence,Volt,-1e-03,1e-05\n",
        lambda i: f"{i},{A[i]},"),
    "Campbell, minima and means": log("10 s, batt [V] = A; temp [Deg C] = B",
        '"TOA5","site"\n"TIMESTAMP","batt","temp"\n"TS","Volts","Deg C"\n"","Min","Avg"\n',
        lambda i: f'"2024-05-17 {clock(i)}",{A[i]},{B[i]}'),
    "ArduPilot": log("0.04 s, GyrX = A; GyrY = B", "FMT, 129, 31, IMU, Qff, TimeUS,GyrX,GyrY\n",
        lambda i: f"IMU, {40000 * i + 8123456}, {A[i]}, {B[i]}"),
    "Davis": log("1800 s, Temp = A", "Date\tTime\tTemp\n", lambda i: f"5/{17 + i // 48}/24\t{davis(i)}\t{A[i]}"),
    "Julian dates": log("1080 s, mag = A", "HJD,mag\n", lambda i: f"{2455000.5 + i / 80:.4f},{A[i]}"),
    "HoboWare text": log("10 s, Temp. [°C] = A", "Plot-Titel: Keller\n#\tDatum Zeit, GMT+02:00\tTemp., °C\n",
        lambda i: f"{i + 1}\t17.05.2024 {clock(i)}\t{german(A[i])}"),
    "Excel, two digits of the year": log("10 s, Temp [°C] = A; Druck [hPa] = B",
        "sep=;\nDatum;Uhrzeit;Temp (°C);Druck (hPa)\n",
        lambda i: f"17.05.24;{clock(i)};{german(A[i])};{german(B[i])}"),
    "multimeter": log("10 s, Sample [V DC] = A", "Reading,Sample,Start Time\n",
        lambda i: f"{i + 1},{A[i]} V DC,05/17/2024 {clock(i)}"),
    "terminal with colours": log("no rate, value 1 = A; value 2 = B",
        "=~=~= PuTTY log 2024.05.17 09:30:00 =~=~=\r\n\x1b[2J\x1b[H",
        lambda i: f"\x1b[0;32m{A[i]},{B[i]}\x1b[0m\r"),
    "ESPHome": log("10 s, Barn [°C] = A; Air [hPa] = B",
        "INFO Starting log output\n[09:00:00][C][wifi:410]:   SSID: 'home'\n",
        lambda i: f"[{clock(i)}][D][sensor:094]: 'Barn': Sending state {A[i]} °C with 1 decimals of accuracy\n"
        f"[{clock(i)}][D][sensor:094]: 'Air' >> {B[i]} hPa"),
    "Tasmota": log("10 s, tele/x/SENSOR.BME280.Temp = A; tele/x/SENSOR.BME280.P = B",
        lambda i: f'{clock(i)}.5 MQT: tele/x/SENSOR = {{"BME280":{{"Temp":{A[i]},"P":{B[i]}}},"Unit":"C"}}'),
    "topics with stamps": log("1 s, barn/temp = A; barn/pressure = B",
        lambda i: f"{1715931000 + i}.123 barn/temp {A[i]}\n{1715931000 + i}.125 barn/pressure {B[i]}"),
    "a value a line": log("no rate, Temperature [C] = A; Pressure [hPa] = B",
        lambda i: f"Temperature: {A[i]} *C\nPressure: {B[i]} hPa\n"),
    "French thousands": log("10 s, Pression = B", "Heure;Pression\n",
        lambda i: f"{clock(i)};{f'{B[i]:,.2f}'.replace(',', ' ').replace('.', ',')}"),
    "Markdown": log("10 s, temp = A", "| t | temp |\n|------|------|\n", lambda i: f"| {clock(i)} | {A[i]} |"),
    "axes": log("no rate, Acceleration X = A; Rotation Y = B", "MPU6050 Found!\n",
        lambda i: f"Acceleration X: {A[i]}, Y: 2.5, Z: 9.81 m/s^2\nRotation X: 0.1, Y: {B[i]}, Z: 0.02 rad/s"),
    "system log": log("1 s, temp = A; p = B", lambda i: f"May 17 {clock(i, 1)} pi app[612]: temp={A[i]} p={B[i]}"),
    "several values of one name at a stamp": log("0.25 s, temp = A; hum = B", "time,name,value\n",
        lambda i: f"{clock(i // 4, 1)},temp,{A[i]}\n{clock(i // 4, 1)},hum,{B[i]}"),
    "rooms and quantities": log("60 s, a.t = A; a.h = B; b.t = B", "time,room,quantity,value\n", lambda i: "".join(
        f"{clock(i, 60)},{key},{value}\n" for key, value in (("a,t", A[i]), ("a,h", B[i]), ("b,t", B[i])))),
    "values with their units and a place": log("1 s, rpm [1/s] = A; v [km/h] = B", "t;PID;VALUE;UNITS;LAT\n",
        lambda i: f"{i};rpm;{A[i]};1/s;48.1{i}\n{i};v;{B[i]};km/h;48.1{i}"),
    "sensors in turn, two values each": log("60 s, bath temp = A; bath hum = B; cellar temp = B",
        "time,room,temp,hum\n",
        lambda i: f"{clock(i, 60)},bath,{A[i]},{B[i]}\n{clock(i, 60)},cellar,{B[i]},{A[i]}"),
    "decimal commas, a comma and a blank between cells": log("1 s, temp = A; pres = B",
        "t, temp, pres\n" + rows(lambda i: f"{i}, {A[i]:.2f}, {B[i]:.2f}\n".replace(".", ","))),
    "a comma after a unit": log("5 s, value 1 [C] = A", lambda i: f"{clock(i, 5)} {A[i]}C, {B[i]}%"),
    "Sea-Bird": log("0.25 s, t090C: Temperature [deg C] = A",
        "* Sea-Bird SBE 19plus\n# name 0 = timeS: Time, Elapsed [seconds]\n# name 1 = t090C: Temperature [deg C]\n"
        "1 2\n3 4\n*END*\n", lambda i: f"{i / 4:11.3f}{A[i]:11.4f}"),
    "a table of calibration above": log("0.1 s, p = A", "Logger 4\npoint,raw\n0,102\n1,480\n2,901\n\ntime,p\n",
        lambda i: f"{i / 10},{A[i]}"),
    "settings with :=": log("0.001 s, ECG [mV] = A; EDA [uS] = B",
        "# Sampling Rate (Hz):= 1000.00\n# Labels:= ECG;EDA\n# Units:= mV;uS\n", lambda i: f"{A[i]}\t{B[i]}"),
    "a ramp without a name": log("0.02 s, value 1 = A", lambda i: f"{A[i]},{i / 50:.2f}"),
    "X beside a voltage": log("2e-06 s, CH 1 [V] = A", "X,CH 1 (V)\n", lambda i: f"{2e-6 * i:.7f},{A[i]}"),
    "one value with a unit": log("1 s, f = A, NaN", "t,f\n" + rows(lambda i: f"{i},{A[i]}\n") + f"{N},1N\n"),
    "a broken date beside a clock": log("10 s, a = A", "date,time,a\n",
        lambda i: f"{'165/165/2165' if i % 3 == 0 else '05/03/2024'},{clock(i)},{A[i]}"),
    "rows that wait, and come at once": log("0.1 s, a = A", "time_s,a\n",
        lambda i: f"{0.1 * i + (0.09 * (5 - i % 20) if 0 < i % 20 < 5 else 0):.3f},{A[i]}"),
    "rows out of order": log("10 s, a = A", "time,a\n" + "".join(f"2024-03-05 {clock(i)},{A[i]}\n" for i in sorted(
        range(N), key=lambda i: i * 7 % N))),
    "NMEA": log("1 s, altitude [m] = A",
        rows(lambda i: nmea(f"GPGGA,0900{i:02}.00,4807.0,N,01131.0,E,1,08,0.9,{A[i]},M,46.9,M,,")),
        nmea("GPGSV,1,1,00")),
    **{f"a clock such as {form.format(7)}": log("3600 s, T [C] = A", "Data;Hora UTC;T (C)\n",
        lambda i, f=form: f"2023/01/{1 + i // 24:02};{f.format(i % 24)};{A[i]}".replace(".", ","))
        for form in ("{:02}00 UTC", "{:02}:00 UTC", "{:02}00")},
    "a flag of missing samples": log("1 s, a = A, NaN", "# bad_flag = -9.990e-29\n# t a\n",
        rows(lambda i: f"{i} {A[i]}\n") + f"{N} -9.990e-29\n"),
    "nines": log("1 s, a = A, NaN", "t;a\n" + rows(lambda i: f"{i}; {A[i]}\n") + f"{N};-999\n"),
    "sqlite3 in the mode line": log("30 s, temp_c = A; p = B",
        lambda i: f"    id = {i + 1}\n    ts = 2024-03-14 {clock(i, 30)}\ntemp_c = {A[i]}\n     p = {B[i]}\n"),
    "upower": log("30 s, energy [Wh] = A; percentage [%] = B", lambda i: f"  vendor:   LGC\n"
        f"  updated:  Thu 14 Mar 2024 {clock(i, 30)} CET (2 seconds ago)\n  battery\n    present:  yes\n"
        f"    energy:   {A[i]} Wh\n    percentage:  {B[i]}%\n"),
    "a date above sensors": log("30 s, Core 0 [°C] = A; temp1 [°C] = B; temp1 2 [°C] = A",
        lambda i: f"Thu Mar 14 {clock(i, 30)} CET 2024\nisa-0\nCore 0:  +{A[i]}°C  (high = +80.0°C)\n\n"
        f"temp1:  +{B[i]}°C\n\ntemp1:  +{A[i]}°C"),
    "LabChart, two blocks": log("0.01 s, ECG = A; Resp = B", lambda i: (
        "Interval=\t0.01 s\nChannelTitle=\tECG\tResp\nRange=\t2 mV\t1 V\n" if i % 20 == 0 else "")
        + f"{i % 20 / 100}\t{A[i]}\t{B[i]}" + ("\t#* note" if i == 7 else "")),
    "date of a British shell": log("30 s, temp ['C] = A; volt [V] = B",
        lambda i: f"Thu 14 Mar {clock(i, 30)} GMT 2024\ntemp={A[i]}'C\nvolt={B[i]}V"),
    "marks before a label": log("no rate, X = A; Y = B", lambda i: f"{'! ' * (i < 5)}X: {A[i]} Y: {B[i]}"),
    "bytes of a DS18B20": log("no rate, t = A",
        lambda i: f"4b 46 7f ff 0e 10 {i:02x} : crc={i:02x} YES\n4b 46 7f ff 0e 10 {i:02x} t={A[i]}"),
    "runs of a simulation": log("no rate, V(out) = A", "time\tV(out)\n",
        lambda i: f"{2 ** (i % 10) * 1e-6 * (i % 10 > 0):e}\t{A[i]}"),
    "IAGA-2002": log("60 s, BOUH = A; BOUF = B", " Format      IAGA-2002      |\n # DECBAS    5527      |\n"
        "DATE       TIME         DOY   BOUH   BOUF   |\n",
        lambda i: f"2024-03-14 {clock(i, 60)}.000 074     {A[i]}  {B[i]}"),
    "names on two lines": log("60 s, temp [C] = A; quality = B", "Zeit,temp (C),temp (C)\n,,quality\n",
        lambda i: f"2024-03-14 {clock(i, 60)},{A[i]},{B[i]}"),
    "weekdays are no sensors": log("86400 s, a = A", "date,day,a\n",
        lambda i: f"2024-{3 + i // 28:02}-{1 + i % 28:02},{DAYS[i % 7]},{A[i]}"),
    "one label in two sections": log("no rate, P = A; air P = B; n = A",
        lambda i: f"---\nstandard\n---\nP: {A[i]}\nair\nP: {B[i]}\n---\nn: {A[i]}\nm: 1\n"),
    "many labels in turn": log("30 s, v [V] = A", lambda i: f"DATE : 2024-03-14 {clock(i, 30)} +0100\n"
        + "".join(f"{c}  : on\n" for c in "abcdefghijk") + f"v : {A[i]} V\nEND  : 2024-03-14 {clock(i, 30)}"),
    "a device and two labels": log("no rate, Id 28FF641E8D3C0C7A T = A; Id 28FF641E8D3C0C7A H = B",
        lambda i: f"Id 28FF641E8D3C0C7A T: {A[i]} H: {B[i]}"),
    "tuples with types": log("10 s, value 1 = A; value 2 = B", lambda i: "(datetime.datetime(2024, 3, 14, "
        f"9, {i // 6}, {i % 6 * 10}, tzinfo=datetime.timezone.utc), np.float64({A[i]}), Decimal('{B[i]}'))"),
    "STX, ETX and a checksum": log("no rate, value 1 = A", lambda i: nmea(f"Q,{A[i]},OK")
        .replace("$", "\2").replace("*", "\3").rstrip()),
    "a series in lines of five": log("0.005 s, value 1 = A", "PEER\nNPTS=  40, DT= .0050 SEC,\n",
        "".join(f"{a:15.7E}" + "\n" * (i % 5 == 4) for i, a in enumerate(A))),
    "256 columns and a separator": log("no rate, value 256 = A", lambda i: ";".join([str(A[i])] * 256) + ";"),
    "MQTT: an object in quotes": log("10 s, t = A",
        lambda i: f"[2024-03-01 {clock(i)}] info: z2m: topic 'home/0x15', payload '{{\"n\": 1, \"t\": {A[i]}}}'"),
    "µs behind ms": log("1.001 s, bpm = A", lambda i: f"00> [{clock(i, 1)}.{i:03},250] <info> app: bpm: {A[i]}"),
    "a count and a colon": log("0.1 s, PV = A", lambda i: f"{i * 100}: SP=30.0 PV={A[i]} OUT=4%"),
    **{f"a stamp written {stamp}": log("0.01 s, T [C] = A", lambda i,
        s=stamp: f"{s.format(i * 10)}T: {A[i]} C") for stamp in ("{}ms ", "[{}ms] ", "({}ms) ")},
    "a clock and a bar": log("10 s, T = A; H = B", lambda i: f"{clock(i)} | T={A[i]} | H={B[i]}"),
    "a table in bars": log("0.1 s, value 1 = A", lambda i: f"| {i / 10} | {A[i]} |"),
    "a count with its unit": log("0.01 s, T [C] = A", lambda i: f"{i * 10} ms: T= {A[i]} C"),
    "time in pairs with its unit": log("0.01 s, t2 [C] = A", lambda i: f"time: {i * 10} ms, t2: {A[i]} C"),
    "Keithley": log("0.1 s, value 1 [VDC] = A", lambda i: f"+{A[i]:.4E}VDC,+{i * 0.1:08.3f}SECS"),
    "vcgencmd": log("no rate, value 1 ['C] = A; value 2 = B", lambda i: f"cpu {A[i]}'C load {B[i]}"),
    "Rigol MSO": log("1e-06 s, CH1V = A; CH2V = B", "CH1V,CH2V,t0 =-8e-05, tInc = 1e-06\n",
        lambda i: f"{A[i]},{B[i]},,"),
    "EasyLog: a serial number beside the first row": log("10 s, Celsius [°C] = A",
        "EL-USB-2,Time,Celsius(°C),Serial Number\n",
        lambda i: f"{i + 1},17/03/2024 {clock(i)},{A[i]}{',010012345' if i == 0 else ''}"),
    "PhysioNet": log("0.004 s, MLII [mV] = A", "'Elapsed time','MLII'\n'hh:mm:ss.mmm','mV'\n",
        lambda i: f"'0:{i * 0.004:06.3f}',{A[i]}"),
    "KNMI: a day and an hour, and a bare mark below the names": log("3600 s, T = A",
        "# STN,YYYYMMDD,   HH,    T\n#\n", lambda i: f"  260,202403{1 + i // 24:02},{i % 24 + 1:5},{A[i]}"),
    "USGS: widths below the names": log("900 s, flow = A", "site\tdatetime\tflow\n15s\t20d\t14n\n",
        lambda i: f"0164\t2024-03-01 {clock(i, 900)}\t{A[i]}"),
    "sar: names beside a stamp": log("10 s, %user = A; %idle = B",
        f"Linux 6.1.0 (host) 03/17/24 _x86_64_\n\n{clock(0)} CPU %user %idle\n",
        lambda i: f"{clock(i + 1)} all {A[i]} {B[i]}"),
    "SQL*Plus: a stamp of two cells": log("10 s, T = A; P = B", "SQL> select;\n\nTS T P\n-------- ----- -----\n",
        lambda i: f"14-MAR-2024 {clock(i)} {A[i]} {B[i]}"),
    "nvidia-smi": log("10 s, power.draw [W] = A; memory.used [MiB] = B",
        "timestamp, gpu, power.draw [W], memory.used [MiB], fan.speed [%]\n",
        lambda i: f"2024/03/14 {clock(i)}.517, 61, {A[i]} W, {B[i]} MiB, [N/A]"),
    "WinCC": log("10 s, T VarValue = A; P VarValue = B", '"VarName";"TimeString";"VarValue";"Validity"\n',
        lambda i: f'"T";"14.03.2024 {clock(i)}";{A[i]};1\n"P";"14.03.2024 {clock(i)}";{B[i]};1'),
    "Octave: a scalar above": log("no rate, value 1 = A",
        f"# Created by Octave\n# type: scalar\n250\n\n\n# type: matrix\n# rows: {N}\n# columns: 1\n",
        lambda i: f" {A[i]}"),
    "Mathematica": log("0.25 s, value 1 = A", lambda i: f"{{{i / 4}, {A[i]}}},"),
    "RRDtool: no name above the time": log("300 s, temp = A; hum = B", "             temp       hum\n\n",
        lambda i: f"{1710664200 + 300 * i}: {A[i]:.4e} {B[i]:.6e}"),
    "names and units in comments": log("0.01 s, pos [mm] = A; vel [mm/s] = B", "%time  pos  vel\n%s  mm  mm/s\n",
        lambda i: f"{i / 100}  {A[i]}  {B[i]}"),
    "MATLAB days": log("60 s, value = A", "datenum,value\n", lambda i: f"{739328.354224537 + i / 1440:.9f},{A[i]}"),
    "pairs with a bar": log("no rate, Angle: x = A; Angle: y = B", lambda i: f"Angle: x= {A[i]} |\ty= {B[i]} |"),
    "a message between marks": log("no rate, value 2 = B", lambda i: f"<{A[i]},{B[i]}>"),
    "Fortran": log("0.01 s, value 1 = A", rows(lambda i: f" {i / 100:.2E} {A[i]:.4E}\n".replace("E", "D"))),
    "Graphtec: a blank after the sign, names above units": log("10 s, CH1 [degC] = A",
        "NO.,Time,ms,CH1\nNO.,Time,ms,degC\n", lambda i: f"{i + 1},2024/03/05 {clock(i)},0,+{A[i]:8.2f}"),
    "Android": log("1 s, x = A; y = B", lambda i: f"03-05 {clock(i, 1)}.250  123  567 D S  : x={A[i]} y={B[i]}"),
    "text for a spreadsheet": log("10 s, Temperature [℃] = A", "Time,Temperature(℃)\n",
        lambda i: f'="2024-03-05 {clock(i)}",="{A[i]}"'),
    "ngspice: names between rules": log("1e-06 s, v(out) = A",
        f"{'-' * 40}\nIndex   time      v(out)\n{'-' * 40}\n", lambda i: f"{i}\t{i * 1e-6:.4e}\t{A[i]}\t"),
    "sensors by a column, with their units": log("0.5 s, speed [km/h] = A; load [%] = B",
        "SECONDS;PID;VALUE;UNITS\n", lambda i: f"{i / 2};speed;{A[i]};km/h\n{i / 2};load;{B[i]};%"),
    "units above some of the columns": log("2.6784e+06 s, tmax = A; sun = B",
        "   yyyy  mm  tmax  sun\n             degC  hours\n",
        lambda i: f"   {1990 + i // 12}  {i % 12 + 1:2d}  {A[i]}  {B[i]}"),
    "a mark at the end": log("no rate, value 2 = B", lambda i: f"$S,{A[i]},{B[i]}#"),
    "LabVIEW: a step above its value": log("0.001 s, value 2 = B", "dt:\n0.001\t0.001\ndata:\n",
        lambda i: f"{A[i]:.3E}\t{B[i]:.6E}"),
    "JSON: columns": log("1 s, hr = A", json.dumps({"time": {"data": list(range(N))}, "hr": {"data": A}})),
    "JSON: a table in a list of one": log("1 s, a = A",
        json.dumps({"results": [{"id": 0, "series": [{"columns": ["time", "a"], "values": list(enumerate(A))}]}]})),
    "JSON: lists": log("1 s, value 1 = A", json.dumps([[1709630000000 + 1000 * i, a] for i, a in enumerate(A)])),
    "objects on lines": log("1 s, v = A", lambda i: f'{{\n  "t": {1710664205 + i},\n  "v": {A[i]}\n}}'),
    "InfluxDB: tags name the series": log("100 s, w bath t = A; w the hall t = B; w the hall h = A",
        lambda i: f"w,room=bath t={A[i]} {17096300 + i}00\nw,room=the\\ hall t={B[i]},h={A[i]} {17096300 + i}00"),
    "JSON of InfluxDB": log("10 s, bath = A; hall = B", json.dumps({"series": [{"tags": {"room": room},
        "columns": ["time", "t"], "values": [[1709630000 + 10 * i, x[i]] for i in range(N)]}
        for room, x in (("bath", A), ("hall", B))]})),
    "one sensor after the other": log("10 s, S1 t = A; S2 h = B", "sensor,time,t,h\n",
        lambda i: f"S1,{clock(i)},{A[i]},{B[i]}", lambda i: f"S2,{clock(i)},{B[i]},{B[i]}"),
    "iperf": log("1 s, value 2 = A", lambda i: f"[  3] {i:4.1f}-{i + 1:4.1f} sec   9 MBytes   {A[i]} Mbits/sec"),
    "documents of ROS": log("0.5 s, imu.x = A; w = B",
        lambda i: f"header:\n  stamp:\n    secs: {1700000000 + i // 2}\n"
        f"    nsecs: {500000000 * (i % 2)}\nimu:\n  x: {A[i]}\nw: {B[i]}\n---"),
    "INSERT statements": log("10 s, temp = A; hum = B", "CREATE TABLE t (id int, temp float);\n",
        lambda i: f"INSERT INTO `t` (`id`,`at`,`temp`,`hum`) VALUES ({i},'2024-03-05 {clock(i)}',{A[i]},{B[i]});"),
    "lists after labels": log("no rate, acc = A; acc 2 = B; gyro 2 = A",
        lambda i: f"acc: {A[i]}, {B[i]}, 9.8 gyro: 1, {A[i]}, 3"),
    "Grbl": log("no rate, MPos = A; MPos 3 = B", lambda i: f"<Idle|MPos:{A[i]},0.000,{B[i]}|FS:0,0>"),
    "Marlin: targets": log("no rate, T = A; B = B", lambda i: f" T:{A[i]} /210.00 B:{B[i]} /60.00 @:0 B@:0"),
    "ArduPilot, decoded": log("1 s, Roll = A; Pitch = B",
        lambda i: f"2024-03-05 {clock(i, 1)}.00: ATT {{TimeUS : {8 + i}, Roll : {A[i]}, Pitch : {B[i]}}}"),
    "lm-sensors": log("no rate, Core 0 [°C] = A; Core 1 [°C] = B",
        lambda i: "coretemp\n" + "".join(f"Core {k}:   +{x[i]}°C  (high = +80°C)\n" for k, x in enumerate((A, B)))),
    "ping: 64 is no stamp": log("no rate, time [ms] = A", lambda i: f"64 bytes from 10.0.0.1: n=9 time={A[i]} ms"),
    "vmstat: names again, and a line above them": log("no rate, free = A",
        lambda i: ("-- memory ---- cpu --\n free idle\n" if i % 20 == 0 else "") + f" {A[i]} {i % 7}"),
    "free: rows of two names": log("no rate, Mem: used = A; Swap: used = B",
        lambda i: f"       total  used\nMem:   9  {A[i]}\nSwap:  9  {B[i]}"),
    "ticks of a board": log("0.02 s, ax = A", lambda i: f"[{20 * i}] ax: {A[i]} ay: {B[i]}"),
    "minutes of HPLC": log("0.3 s, mAU = A", "Min\tmAU\n", lambda i: f"{i * 0.005:.3f}\t{A[i]}"),
    "a spectrum": log("no rate, value 2 = A", ">>>Begin Spectral Data<<<\n",
        lambda i: f"{339.36 + 0.38 * i:.2f}\t{A[i]}"),
    "SampleTime[ms]": log("0.01 s, value 1 = A", "SampleTime[ms]\t10\n\n", lambda i: f"{10 * i}\t{A[i]}"),
    "Kibana": log("10 s, cpu = A", "time,cpu\n", lambda i: f'"Nov 27, 2026 @ {clock(i)}.123","{A[i]}"'),
    "Korean: half a day first": log("10 s, v = A", "t,v\n", lambda i: f"2024. 3. 5. 오전 {clock(i)},{A[i]}"),
    "rows of an array": log("0.1 s, value 1 = A", f"[[0.0 {A[0]}]\n",
        "".join(f" [{i / 10} {A[i]}]{']' * (i == N - 1)}\n" for i in range(1, N))),
    "units line by line above the names": log("10 s, p [hPa] = A", "t, seconds, of day\np, hPa, air\n18\nt, p\n",
        lambda i: f"{50400 + 10 * i}, {A[i]}"),
    "openHAB": log("10 s, Barn [°C] = A",
        lambda i: f"2024-03-05 {clock(i)}.123 [INFO ] [openhab.Event ] - Item 'Barn' changed from 1 to {A[i]} °C"),
    "ESPHome: a label in some turns": log("10 s, T [°C] = A; H [%] = B",
        lambda i: "\n".join(f"[{clock(i)}][D][sensor:094]: '{name}': Sending state {state}"
            for name, state in (("T", f"{A[i]} °C"), ("H", f"{B[i]} %"), ("WiFi", "-63 dBm"))[: 3 - (i % 3 > 0)])),
    "columns of Fortran that meet": log("2 s, value 1 = A", lambda i: f" {2 * i}.00 {A[i]:.6E}-1.00000E+00"),
    "currencies and marks": log("10 s, cost [$] = A; rain = B", "t,cost,rain\n",
        lambda i: f"{10 * i},${A[i]},{B[i]}{'*' * (i % 3 == 0)}"),
    "PVGIS": log("3600 s, P = A", "time,P\n", lambda i: f"202006{1 + i // 24:02}:{i % 24:02}10,{A[i]}"),
    "ArduPilot: names of each kind": log("1 s, ATT = A; BARO = B",
        "FMT, 1, 9, ATT, Qf, TimeUS,Roll\nFMT, 2, 9, BARO, Qf, TimeUS,Alt\n",
        lambda i: "\n".join(f"{kind}, {10**6 * (i + 80)}, {x[i]}" for kind, x in (("ATT", A), ("BARO", B)))),
    "VBOX": log("0.1 s, sats = A; height = B", "[column names]\nsats time height\n\n[data]\n",
        lambda i: f"{A[i]} 1016{i / 10:05.2f} {B[i]}"),
    "OpenSignals": log("0.001 s, A1 = A; A2 = B",
        '# {"98:D3": {"sampling rate": 1000, "column": ["nSeq", "A1", "A2"]}}\n# EndOfHeader\n',
        lambda i: f"{i}\t{A[i]}\t{B[i]}\t"),
    "ActiGraph": log("0.05 s, value 1 = A", "--- date format M/d/yyyy at 20 Hz  Filter Normal ---\nSerial: 7\n",
        lambda i: f"{A[i]},{B[i]}"),
    "a frame of pandas": log("10 s, temp = A; hum = B", "                      temp   hum\ntime\n",
        lambda i: f"2024-03-05 {clock(i)}  {A[i]}  {B[i]}"),
    "upslog": log("10 s, value 1 = A", lambda i: f"20240305 {clock(i).replace(':', '')} {A[i]} [OL] NA {B[i]}"),
    "turbostat: a summary beside the processors": log("5 s, - Busy = A; 0 Busy = B", "t\tCore\tCPU\tBusy\tW\n",
        lambda i: "".join(f"{1699454321 + 5 * i}\t{k}\t{k}\t{x[i]}\t7\n" for k, x in (("-", A), (0, B), (1, A)))),
    "TwinCAT: a second clock that ends early": log("no rate, value 1 = A",
        lambda i: f"{i}\t{A[i]}\t{i}\t{B[i]}\t" + (f"{2 * i}\t{B[i]}" if 2 * i < N else " \t ")),
    "only changes": log("no rate, a = A", "time,a\n", lambda i: f"{int(T[i])},{A[i]}"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", LOGS)
def test_a_usual_log_is_read_right(read, name):
    text, period, channels = LOGS[name]
    recording = read(text, "log.json" if name.startswith("JSON") else "log.txt")
    assert recording.report.rejected == 0
    assert recording.report.read_as
    assert recording.sample_period == (None if period is None else pytest.approx(period))
    units = dict(zip(recording.names, recording.units, strict=True))
    for (channel, unit), values in channels.items():
        assert units[channel] == unit
        np.testing.assert_array_equal(recording.channel(channel), values)


def test_a_common_factor_is_named(read):
    recording = read("x =\n\n   1.0e+03 *\n\n" + rows(lambda i: f"   {A[i]}  {B[i]}\n"))
    assert "the numbers are not multiplied by the 1.0e+03 above them" in recording.report.assumptions
    np.testing.assert_array_equal(recording.values[:, 0], A)


def test_what_could_be_one_number_or_two_is_asked_about(read):
    text = rows(lambda i: f"1.0{10 + i % 9},25\n")
    assert "it could also be 1 column: --delimiter semicolon" in read(text).report.notes
    one = read(text, delimiter=";")
    np.testing.assert_array_equal(one.values[:, 0], [1010.25 + i % 9 for i in range(N)])


def test_a_label_that_is_lost_shifts_no_other(read):
    lines = [line for i in range(N) for line in (f"Temp: {A[i]}\n", f"Press: {B[i]}\n")]
    recording = read("".join(line for i, line in enumerate(lines) if i not in (21, 30)))
    known = recording.channel("Press")[np.isfinite(recording.channel("Press"))]
    np.testing.assert_array_equal(known, B[:10] + B[11:])
    both = recording.values[np.isfinite(recording.values).all(axis=1)]
    assert {tuple(row) for row in both} <= set(zip(A, B, strict=True))


@pytest.mark.parametrize(("names", "text"), [
    ("h/t h/c", rows(lambda i: f"2024-03-05T{clock(i)}+0100 h/{'c' if i % 9 == 5 else 't'} {A[i]}\n")),
    ("a.b c", rows(lambda i: json.dumps({"t": i} | ({"a": {"b": A[i]}} if i != 7 else {}) | {"c": i % 7}) + "\n")),
])  # fmt: skip
def test_a_label_that_is_rare_or_lacks_once_loses_no_line(read, names, text):
    recording = read(text)
    assert (" ".join(recording.names), len(recording), recording.report.rejected) == (names, N, 0)


@pytest.mark.parametrize(("text", "assumed"), [
    ("t,a\n" + rows(lambda i: f"{5012 + 2000 * i + (i % 9 == 0)},{A[i]}\n"),
        "0.500 Hz; one every 33.3 min with --time-unit s, 500 Hz"),
    ("time,a\n" + rows(lambda i: f"03/04/2025 {clock(i)},{A[i]}\n"), "read day first"),
    ("Record of 280\n" + rows(lambda i: f"{' '.join(str(A[(7 * i + k) % N]) for k in range(7))}\n"), "row by row"),
    ("t,a\n" + rows(lambda i: f"{1000 * (i // 10 * 10 - i % 10)},{A[i]}\n"), "rows of the file step back"),
    ("Time [s],Channel 0\n" + rows(lambda i: f"{CHANGES[i]:.7f},{i % 2}\n"), "the stamps have no rate"),
    ("t,r\n" + rows(lambda i: f"{i},{A[i]}{'k' * (i % 3 > 0)}\n"), '"20.0" in "r" is in k as well'),
    ("t,room,a\n" + rows(lambda i: f"{i},{'ab'[i % 2]},{A[i]}\n"), 'one of 2 sensors, by "room"'),
    ("t,a\n" + rows(lambda i: f"{i},{A[i] if i else '+9.910000E+37'}\n"), "9.91e+37 is a missing value"),
    ("t,a,b\n" + rows(lambda i: f"{i},{A[i]},{A[i] if i % 3 == 0 else f'x{i}'}\n"), 'most cells of "b"'),
])  # fmt: skip
def test_what_the_file_does_not_show_is_said_at_once(read, text, assumed):
    recording = read(text)
    assert any(assumed in sentence for sentence in recording.report.assumptions), recording.report.assumptions
    assert set(recording.report.assumptions) <= set(recording.report.notes)


def test_a_remark_between_rows_begins_no_new_table(read):
    row = [f"{i / 2},{A[i]}\n" for i in range(N)]
    recording = read("t,a\n" + "".join(row[:5]) + "\nreconnect,now\n" + "".join(row[5:]))
    assert (recording.report.rows, recording.report.comments, recording.sample_period) == (N, 1, 0.5)
    recording = read("a,b\n" + "".join(row[:5]) + "reconnect,now\nERR,ERR\n" + "".join(row[5:]) + "End,\n")
    assert (recording.report.rows, recording.report.comments, recording.report.bad_cells) == (N + 1, 2, 2)


def test_units_that_repeat_are_no_names(read):
    text = "date time a b c d\ns V V V V\n" + rows(lambda i: f"2025-03-04 {clock(i)} {' '.join([str(A[i])] * 4)}\n")
    assert read(text).names == ("a", "b", "c", "d")


@pytest.mark.parametrize("text", [
    rows(lambda i: f"{i * 7919 % 65536:04x}\n"),
    "n,v\n" + rows(lambda i: f"{i},{A[i] if i % 3 == 0 else f'x{i}'}\n"),
])  # fmt: skip
def test_debris_is_refused(read, text):
    with pytest.raises(BadFile, match="must"):
        read(text)


@pytest.mark.parametrize(("encoding", "name"), [
    ("cp1251", "Температура"), ("cp932", "気温"), ("gb2312", "湿度"), ("latin-1", "Größe")])  # fmt: skip
def test_names_of_any_language_are_read_in_their_encoding(tmp_path, encoding, name):
    text = f"t (s),{name} (C)\n"
    (tmp_path / "a.csv").write_bytes((text + rows(lambda i: f"{i},{A[i]}\n")).encode(encoding))
    assert read_recording(tmp_path / "a.csv").names == (name,)
