"""Results as text tables and as a plot."""

from .modes import MODES, BenchError, format_size


def format_table(header, rows):
    widths = [max(len(str(row[i])) for row in [header] + rows) for i in range(len(header))]
    lines = ['  '.join(str(cell).rjust(width) for cell, width in zip(row, widths)) for row in [header] + rows]
    return '\n'.join([lines[0], '-' * len(lines[0])] + lines[1:])


def format_number(value):
    if value is None:
        return '-'
    return f'{value:.0f}' if value >= 100 else f'{value:.1f}' if value >= 10 else f'{value:.2f}'


def format_ratio(ratio):
    return '-' if ratio is None else f'{ratio[0]:.2f} ({ratio[1]:.2f}..{ratio[2]:.2f})'


def report(results, modes):
    """All tables as one text."""
    texts = []
    labels = [mode.label for mode in modes]
    fan_outs = results.fan_outs('latency')
    if fan_outs:
        rows, cpu_rows = [], []
        for subscribers in fan_outs:
            for size in results.sizes('latency', subscribers):
                match = {'size': size, 'subscribers': subscribers}
                cells = [format_size(size), subscribers, format_number(results.median('latency', 'rate_hz', **match))]
                for mode in modes:
                    cells.append('/'.join(format_number(results.median('latency', f'{p}_us', mode=mode.key, **match))
                                          for p in ('p50', 'p90', 'p99', 'max')))
                floor = results.median('floor', 'p50_us', **match)
                latency = results.median('latency', 'p50_us', mode='pi_os', **match)
                rows.append(cells + [format_ratio(results.ratio('latency', 'p50_us', 'tcpros', 'pi_os', **match)),
                                     format_ratio(results.ratio('latency', 'p50_us', 'nodelay', 'pi_os', **match)),
                                     format_number(results.median('floor', 'warm_p50_us', **match)),
                                     format_number(floor),
                                     format_number(latency / floor if latency and floor else None)])
                cpu = [format_size(size), subscribers]
                cpu += [format_number(results.median('latency', 'cpu_us', mode=mode.key, **match)) for mode in modes]
                cpu += [format_ratio(results.ratio('latency', 'cpu_us', 'pi_os', 'tcpros', **match))]
                cpu += [format_number(results.median('latency', 'last_p50_us', mode=mode.key, **match))
                        for mode in modes]
                cpu += [format_number(results.median('latency', 'publish_p50_us', mode=mode.key, **match))
                        for mode in modes]
                cpu_rows.append(cpu)
        texts.append('Latency publish() -> callback, p50/p90/p99/max [us] over all subscribers; ratios of p50, median '
                     'of the rounds (min..max);\nfloor: p50 of one serialisation and the deserialisations alone, '
                     'spread over the cores, at the same rate (warm: back to back) [us]\n' +
                     format_table(['size', 'subs', 'Hz'] + labels +
                                  ['TCPROS/π-OS', 'tcpNoDelay/π-OS', 'warm floor', 'floor', 'π-OS/floor'], rows))
        texts.append('CPU time per message, all processes together, without the benchmark\'s own filling and '
                     'checking [us];\np50 until the last subscriber has the message [us]; '
                     'p50 of publish() itself [us]\n' +
                     format_table(['size', 'subs'] + [f'CPU {label}' for label in labels] + ['CPU π-OS/TCPROS'] +
                                  [f'last {label}' for label in labels] + [f'publish {label}' for label in labels],
                                  cpu_rows))
        behind = [f'{MODES[row["mode"]].label} {format_size(row["size"])} to {row["subscribers"]}: {row["late"]} of '
                  f'{row["messages"]}' for row in results.rows
                  if row['measure'] == 'latency' and row['late'] > 0.05 * row['messages']]
        if behind:
            texts.append('The publisher fell behind its rate by more than one interval: ' + '; '.join(behind))
    for subscribers in results.fan_outs('throughput'):
        rows = []
        for size in results.sizes('throughput', subscribers):
            match = {'size': size, 'subscribers': subscribers}
            cells = [format_size(size), format_number(results.median('throughput', 'window', **match))]
            for mode in modes:
                cells += [format_number(results.median('throughput', 'messages_per_s', mode=mode.key, **match)),
                          format_number(results.median('throughput', 'gigabytes_per_s', mode=mode.key, **match))]
            rows.append(cells + [format_ratio(results.ratio('throughput', 'messages_per_s', 'pi_os', stock, **match))
                                 for stock in ('tcpros', 'nodelay')])
        header = ['size', 'window'] + [text for label in labels for text in (f'{label} msg/s', 'GB/s')]
        texts.append(f'Throughput, {subscribers} subscriber(s), back to back, at most `window` messages ahead of the '
                     'subscriber\'s acknowledgements\n' +
                     format_table(header + ['π-OS/TCPROS', 'π-OS/tcpNoDelay'], rows))
    rest = [mode for mode in modes if results.values('idle', 'cpu_percent', mode=mode.key)]
    if rest:
        fields = [('idle', 'cpu_percent', 'idle, connected: CPU of one core [%]'),
                  ('idle', 'switches_per_s', 'idle, connected: voluntary context switches [1/s]')]
        for name in ('publisher', 'subscriber'):
            fields += [('memory', f'{name}_private_kb', f'{name} node: private memory [kB]'),
                       ('memory', f'{name}_pool_kb', f'{name} node: pool, resident [kB]'),
                       ('memory', f'{name}_pool_used_kb', f'{name} node: pool after the further ones [kB]'),
                       ('memory', f'per_{name}_connected_kb', f'per further {name}, connected: private [kB]'),
                       ('memory', f'per_{name}_kb', f'per further {name}, used once: private [kB]')]
        rows = [[text.ljust(max(len(t) for _, _, t in fields))] +
                [format_number(results.median(measure, field, mode=mode.key)) for mode in rest] +
                [format_ratio(results.difference(measure, field, 'pi_os', 'tcpros'))]
                for measure, field, text in fields if results.values(measure, field)]
        texts.append('Nodes at rest\n' + format_table([''] + [mode.label for mode in rest] + ['π-OS - TCPROS'], rows))
    return '\n\n'.join(texts)


def require_matplotlib():
    try:
        import matplotlib
    except ImportError:
        raise BenchError('--plot needs matplotlib: apt-get install python3-matplotlib') from None
    return matplotlib


def plot(results, modes, path, subtitle):
    """Latency by size and by number of subscribers as PNG."""
    require_matplotlib().use('Agg')
    from matplotlib import pyplot

    styles = {'tcpros': ('tab:red', 'o'), 'nodelay': ('tab:orange', 's'), 'pi_os': ('tab:blue', '^')}
    figure, (by_size, by_number) = pyplot.subplots(1, 2, figsize=(13, 5.2))
    sizes = results.sizes('latency', 1)
    for mode in modes:
        color, marker = styles[mode.key]
        for field, style, alpha in (('p50_us', '-', 1.0), ('p99_us', ':', 0.6)):
            values = [results.median('latency', field, mode=mode.key, size=size, subscribers=1) for size in sizes]
            by_size.plot(sizes, values, style, color=color, marker=marker, alpha=alpha, markersize=4,
                         label=f'{mode.label}, {field[:3]}')
    floors = [results.median('floor', 'p50_us', size=size, subscribers=1) for size in sizes]
    if all(floors):
        by_size.plot(sizes, floors, '--', color='gray', label='copy floor')
    by_size.set(xscale='log', yscale='log', xlabel='payload [bytes]', ylabel='latency publish() to callback [us]',
                title='one subscriber')
    fan_outs = results.fan_outs('latency')
    fan_out_sizes = sorted({size for number in fan_outs if number > 1 for size in results.sizes('latency', number)})
    for style, size in zip(('-', '--', '-.', ':'), fan_out_sizes):
        for mode in modes:
            color, marker = styles[mode.key]
            numbers = [n for n in fan_outs if size in results.sizes('latency', n)]
            values = [results.median('latency', 'p50_us', mode=mode.key, size=size, subscribers=n) for n in numbers]
            by_number.plot(numbers, values, style, color=color, marker=marker, markersize=4,
                           label=f'{mode.label}, {format_size(size)}')
    by_number.set(yscale='log', xlabel='subscribers', ylabel='p50 latency [us]', title='by number of subscribers',
                  xticks=fan_outs)
    for axes in (by_size, by_number):
        axes.grid(True, which='both', alpha=0.25)
        if axes.lines:
            axes.legend(fontsize=8, loc='upper left', ncol=2 if axes is by_number else 1)
    figure.suptitle(subtitle, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
