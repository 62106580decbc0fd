"""MAP adaptation of the acoustic model en-us (phonetically tied mixtures) to clips of commands.

Gauvain and Lee 1994, with a fixed weight of the prior: m = (tau m0 + sum gamma x) / (tau + sum gamma) for means, the
same for mixture weights. The counts gamma come from one Baum-Welch pass of sphinxtrain's bw with the model itself.
Variances and transitions stay.
"""

import shutil

import package_path  # noqa: F401: leads to pi_speech
import numpy as np

import sphinx_files
from pi_speech.errors import ToolError
from requirements import ACOUSTIC_MODEL, BAUM_WELCH

TAU_MEANS = 5.0     # frames of a Gaussian
TAU_WEIGHTS = 50.0  # frames of a stream of a senone
FEATURES = ["-ts2cbfn", ".ptm.", "-feat", "1s_c_d_dd", "-svspec", "0-12/13-25/26-38", "-cmn", "batch", "-agc", "none",
            "-varnorm", "no"]
FILLERS = "<s> SIL\n</s> SIL\n<sil> SIL\n"


def map_means(prior, sums, occupation, tau):
    """@param prior, sums  codebook x stream x density x length
    @param occupation  codebook x stream x density"""
    return (tau * prior + sums) / (tau + occupation[..., None])


def map_weights(prior, counts, tau):
    """@param prior, counts  senone x stream x density; the prior is normalised here"""
    prior = prior / prior.sum(2, keepdims=True)
    return (tau * prior + counts) / (tau + counts.sum(2, keepdims=True))


class BaseModel:
    """The model en-us as bw takes it, in a folder."""

    def __init__(self, folder):
        self.definition = folder / "mdef.txt"
        self.weights = folder / "mixture_weights"
        self.dictionary = folder / "words.dict"
        self.fillers = folder / "fillers.dict"

    def write(self, call, dictionary):
        """@param dictionary  text of the pronunciations"""
        self.definition.parent.mkdir(exist_ok=True)
        call("mdef", ["pocketsphinx_mdef_convert", "-text", ACOUSTIC_MODEL / "mdef", self.definition])
        sphinx_files.write_mixture_weights(self.weights, sphinx_files.read_sendump(ACOUSTIC_MODEL / "sendump"))
        self.dictionary.write_text(dictionary)
        self.fillers.write_text(FILLERS)


def count(call, base, name, transcripts, features, folder):
    """One pass of bw. @param transcripts  key -> word or variant of it, as on(2)
    @param features  folder of KEY.mfc
    @param folder  of the counts; made anew"""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    control, sentences = folder / "clips.ctl", folder / "clips.lsn"
    control.write_text("".join(f"{key}\n" for key in transcripts))
    sentences.write_text("".join(f"<s> {word} </s> ({key})\n" for key, word in transcripts.items()))
    call(name, [BAUM_WELCH, "-moddeffn", base.definition, "-mixwfn", base.weights, "-meanfn", ACOUSTIC_MODEL / "means",
                "-varfn", ACOUSTIC_MODEL / "variances", "-tmatfn", ACOUSTIC_MODEL / "transition_matrices", *FEATURES,
                "-dictfn", base.dictionary, "-fdictfn", base.fillers, "-cepdir", features, "-cepext", "mfc",
                "-timing", "no", "-ctlfn", control, "-lsnfn", sentences, "-accumdir", folder])
    if not (folder / "gauden_counts").is_file():
        raise ToolError(f"bw has counted nothing in {folder}: no clip fits its word")


def adapt(base, counts, folder, extra):
    """Writes means, sendump and pronunciations.dict.
    @param counts  folders of count(); @param extra  text of the pronunciations that the dictionary lacks
    @return frames that were counted"""
    sums = occupation = weights = 0.0
    for part in counts:
        part_sums, _, part_occupation = sphinx_files.read_gaussian_counts(part / "gauden_counts")
        sums, occupation = sums + part_sums, occupation + part_occupation
        weights = weights + sphinx_files.read_mixture_weights(part / "mixw_counts")
    folder.mkdir(parents=True, exist_ok=True)
    means = map_means(sphinx_files.read_gaussians(ACOUSTIC_MODEL / "means"), sums, occupation, TAU_MEANS)
    sphinx_files.write_gaussians(folder / "means", means)
    sphinx_files.write_sendump(folder / "sendump",
                               map_weights(sphinx_files.read_mixture_weights(base.weights), weights, TAU_WEIGHTS))
    (folder / "pronunciations.dict").write_text(extra)
    return float(np.round(weights.sum() / weights.shape[1]))
