"""Results of a comparison between devices as text tables and as a plot."""

from .modes import format_size
from .output import format_number, format_ratio, format_table, require_matplotlib

MB = 1000000


def report(results, modes):
    """All tables as one text."""
    parts = (_wire, _throughput, _latency, _priority, _cut, _kill, _hostile)
    return '\n\n'.join(text for text in (part(results, modes) for part in parts) if text)


def _rows(results, measure, **match):
    return [row for row in results.rows
            if row['measure'] == measure and all(row.get(key) == value for key, value in match.items())]


def _spread(results, measure, field, scale=1.0, **match):
    """Median of the rounds (min..max)."""
    values = list(results.values(measure, field, **match).values())
    if not values:
        return '-'
    median = results.median(measure, field, **match)
    return f'{format_number(median / scale)} ({format_number(min(values) / scale)}..' \
           f'{format_number(max(values) / scale)})'


def _ratios(results, measure, field, **match):
    """How many times more stock has of `field` than π-OS, one cell per stock mode."""
    return [format_ratio(results.ratio(measure, field, stock, 'pi_os', **match)) for stock in ('tcpros', 'nodelay')]


def _wire(results, modes):
    if not _rows(results, 'wire'):
        return ''
    rows = [[number] + [_spread(results, 'wire', 'sent_per_message', MB, mode=mode.key, subscribers=number)
                        for mode in modes] + _ratios(results, 'wire', 'sent_per_message', subscribers=number)
            for number in results.fan_outs('wire')]
    return 'Bytes on the wire per message of 1 MB [MB], all subscribers on one other device; median of the rounds ' \
           '(min..max)\n' + format_table(['subs'] + [mode.label for mode in modes] +
                                         ['TCPROS/π-OS', 'tcpNoDelay/π-OS'], rows)


def _throughput(results, modes):
    if not _rows(results, 'throughput'):
        return ''
    rows = [[mode.label, _spread(results, 'throughput', 'messages_per_s', mode=mode.key),
             _spread(results, 'throughput', 'delivered_mbit', mode=mode.key),
             format_ratio(results.ratio('throughput', 'messages_per_s', mode.key, 'tcpros'))] for mode in modes]
    return 'Throughput of 1 MB to 5 subscribers on one device over 1 Gbit/s, back to back\n' + \
        format_table(['', 'messages/s', 'delivered [Mbit/s]', 'by TCPROS'], rows)


def _latency(results, modes):
    rows = []
    for number in results.fan_outs('latency') if _rows(results, 'latency') else ():
        for size in results.sizes('latency', number):
            match = {'size': size, 'subscribers': number}
            rows.append([format_size(size), number,
                         format_number(results.median('latency', 'rate_hz', **match))] +
                        ['/'.join(format_number(results.median('latency', field, mode=mode.key, **match))
                                  for field in ('p50_us', 'p99_us')) for mode in modes] +
                        _ratios(results, 'latency', 'p50_us', **match) + _ratios(results, 'latency', 'p99_us', **match))
    return rows and 'Latency publish() -> callback on another device, p50/p99 [us] over all subscribers, no limit on ' \
        'the cable; ratios: median of the rounds (min..max)\n' + \
        format_table(['size', 'subs', 'Hz'] + [mode.label for mode in modes] +
                     ['p50 TCPROS/π-OS', 'p50 tcpNoDelay/π-OS', 'p99 TCPROS/π-OS', 'p99 tcpNoDelay/π-OS'], rows)


def _priority(results, modes):
    tables = []
    for mbit in sorted({row['mbit'] for row in _rows(results, 'priority')}):
        rows = [[mode.label] + [_spread(results, 'priority', field, mode=mode.key, mbit=mbit)
                                for field in ('p50_ms', 'p99_ms', 'max_ms', 'image_mbit')] for mode in modes]
        tables.append(
            f'Small messages (320 B, 200 Hz) beside images (6.2 MB) that fill a network of {mbit} Mbit/s; none lost\n' +
            format_table(['', 'p50 [ms]', 'p99 [ms]', 'max [ms]', 'images [Mbit/s]'], rows) +
            '\nTCPROS/π-OS, tcpNoDelay/π-OS: p50 ' + ', '.join(_ratios(results, 'priority', 'p50_ms', mbit=mbit)) +
            '; p99 ' + ', '.join(_ratios(results, 'priority', 'p99_ms', mbit=mbit)))
    return '\n\n'.join(tables)


def _cut(results, modes):
    if not _rows(results, 'cut'):
        return ''
    rows = [[mode.label, how] + [_spread(results, 'cut', field, mode=mode.key, how=how)
                                 for field in ('first_ms', 'fresh_ms', 'oldest_ms', 'old')]
            for how in ('loss', 'down') for mode in modes]
    seconds = max(row['seconds'] for row in _rows(results, 'cut'))
    return f'After a cut of {seconds:g} s (loss: every packet is lost; down: the interface goes down), 100 kB at ' \
        '50 Hz, queue 10\n' + format_table(['', 'cut', 'restore to first message [ms]', 'to first new message [ms]',
                                     'oldest message [ms]', 'old messages'], rows)


def _kill(results, _):
    return '\n'.join(f'The bridge killed {row["kills"]} times, either side in turn, during 50 kB at 100 Hz: longest '
                     f'gap between two messages {row["gap_max_ms"]:.0f} ms, median of the longest of each kill '
                     f'{row["gap_p50_ms"]:.0f} ms; {row["lost"]} of {row["messages"]} messages lost, none out of order'
                     for row in _rows(results, 'kill'))


def _hostile(results, _):
    return '\n'.join(f'{row["frames"]} hostile frames, each on a connection of its own, in {row["seconds"]:.0f} s, '
                     f'beside 100 kB at 100 Hz: all {row["messages"]} messages arrived in order, longest gap '
                     f'{row["gap_max_ms"]:.0f} ms; the bridge grew by {row["growth_kb"]} kB; refused: ' +
                     ', '.join(f'{reason} {count}' for reason, count in row['refused'].items())
                     for row in _rows(results, 'hostile'))


def plot(results, modes, path, subtitle):
    """Bytes on the wire by number of subscribers, and latency by size, as PNG."""
    require_matplotlib().use('Agg')
    from matplotlib import pyplot

    styles = {'tcpros': ('tab:red', 'o'), 'nodelay': ('tab:orange', 's'), 'pi_os': ('tab:blue', '^'),
              'pi_os_tls': ('tab:green', 'v'), 'nanomsg': ('tab:purple', 'D')}
    figure, (wire, latency) = pyplot.subplots(1, 2, figsize=(13, 5.2))
    numbers = results.fan_outs('wire') if _rows(results, 'wire') else []
    for mode in modes:
        color, marker = styles[mode.key]
        values = [results.median('wire', 'sent_per_message', mode=mode.key, subscribers=number) for number in numbers]
        if numbers and None not in values:
            width = 4 if mode.key == 'tcpros' else 1.5  # the two stock lines lie upon each other
            wire.plot(numbers, [value / MB for value in values], '-', color=color, marker=marker, label=mode.label,
                      linewidth=width)
        for number, style in zip(results.fan_outs('latency') if _rows(results, 'latency') else (), ('-', '--', ':')):
            sizes = results.sizes('latency', number)
            values = [results.median('latency', 'p50_us', mode=mode.key, size=size, subscribers=number)
                      for size in sizes]
            if None not in values:
                latency.plot(sizes, values, style, color=color, marker=marker, markersize=4,
                             label=f'{mode.label}, {number} subscriber(s)')
    wire.set(xlabel='subscribers on one other device', ylabel='bytes on the wire per message of 1 MB [MB]',
             xticks=numbers, title='network')
    wire.set_ylim(bottom=0)
    latency.set(xscale='log', yscale='log', xlabel='payload [bytes]', ylabel='p50 latency publish() to callback [us]',
                title='latency between devices')
    for axes in (wire, latency):
        axes.grid(True, which='both', alpha=0.25)
        if axes.lines:
            axes.legend(fontsize=8)
    figure.suptitle(subtitle, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
