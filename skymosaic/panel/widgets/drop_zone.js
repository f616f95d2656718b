// Sends files that were chosen or dropped, one after the other, as raw bodies; the server decides what it accepts. Its
// reasons for refusing files stay until they are dismissed.
export default {
  template: `
    <div class="drop">
      <label class="drop-zone" :class="{over, busy: sending}" @dragover.prevent="over = true" @dragleave="over = false"
        @drop.prevent="onDrop">
        <input ref="input" type="file" :accept="accept" :multiple="multiple" :aria-label="label"
          :disabled="sending !== ''" @change="send($refs.input.files)">
        <span class="drop-title">{{ sending || title }}</span>
        <span class="drop-hint">{{ sending ? percent + ' %' : hint }}</span>
      </label>
      <div class="refusals" role="alert" v-if="refusals.length">
        <p class="fault" v-for="line in refusals">{{ line }}</p>
        <button type="button" @click="refusals = []">Dismiss</button>
      </div>
    </div>`,
  props: { url: String, accept: String, multiple: Boolean, label: String, title: String, hint: String },
  data() {
    return { over: false, sending: "", percent: 0, refusals: [] };
  },
  methods: {
    onDrop(event) {
      this.over = false;
      this.send(event.dataTransfer.files);
    },
    async send(files) {
      for (const file of Array.from(files).slice(0, this.multiple ? undefined : 1)) {
        this.sending = "Sending " + file.name;
        this.percent = 0;
        const fault = await this.post(file);
        if (fault) this.refusals.push(fault);
      }
      this.sending = "";
      this.$refs.input.value = "";
    },
    post(file) {
      return new Promise((resolve) => {
        const request = new XMLHttpRequest();
        request.open("POST", this.url + "?name=" + encodeURIComponent(file.name));
        request.upload.onprogress = (event) => (this.percent = Math.round((100 * event.loaded) / event.total));
        request.onload = () => resolve(request.status < 300 ? "" : request.responseText);
        request.onerror = () => resolve(file.name + ": the upload was refused or interrupted; is the file too large?");
        request.send(file);
      });
    },
  },
};
